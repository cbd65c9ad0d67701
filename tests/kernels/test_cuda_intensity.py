"""The CUDA kernels `own_intensity` and `relief` against the float64 reference and the CPU kernels."""

import numpy as np
import pytest

from srt3d_ros.core import layout

from .frames import GATE, RELATIVE, T, make_frame, make_state
from .on_device import frame_on, others


@pytest.mark.parametrize(("shape", "surfaces"), [((6, 40), 1), ((3, 33), 2)])
def test_own_intensity(cuda, shape, surfaces):
    frame = make_frame(shape, 0)
    state = make_state(frame, surfaces, 0)
    into = cuda.array(np.full((state.shape[0], surfaces, state.shape[3]), np.nan, np.float32))
    assert cuda.own_intensity(frame_on(cuda, frame.padded), cuda.array(state), into) is into
    for other in others():
        expected = other.own_intensity(frame.padded, state)
        np.testing.assert_allclose(cuda.numpy(into), expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize(("shape", "surfaces", "radius"), [((6, 40), 1, 2), ((3, 33), 2, 4),
                                                           ((6, 40), 1, layout.MARGIN)])
def test_relief(cuda, shape, surfaces, radius):
    state = make_state(make_frame(shape, 0), surfaces, 0)
    into = cuda.array(np.zeros((state.shape[0], surfaces, state.shape[3]), np.float32))
    assert cuda.relief(cuda.array(state), 2.5, radius, GATE, T, into) is into
    found = cuda.numpy(into)
    for other in others():
        np.testing.assert_allclose(found, other.relief(state, 2.5, radius, GATE, T), rtol=RELATIVE, atol=1e-4)
    assert (found > 0.1).sum() > 70 and (found[state[:, :, layout.INTENSITY] == 0] == 0).all()
