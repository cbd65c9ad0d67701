"""The CUDA kernels `descend` and `explain` against the float64 reference and the CPU kernels."""

import numpy as np
import pytest

from srt3d_ros.core import layout

from .frames import GATE, T, assert_states_agree, exact_frame, exact_state, make_frame, make_state
from .on_device import frame_on, others


@pytest.mark.parametrize(("shape", "surfaces", "radius"), [((6, 40), 1, 1), ((3, 33), 2, 2),
                                                           ((5, 32), 1, layout.MARGIN)])
def test_descend(cuda, shape, surfaces, radius):
    frame = make_frame(shape, seed=1)
    state = make_state(frame, surfaces, seed=1)
    given, into = cuda.array(state), cuda.array(np.zeros_like(state))
    assert cuda.descend(frame_on(cuda, frame.padded), given, radius, GATE, out=into) is into
    assert np.array_equal(cuda.numpy(given), state)
    found = cuda.numpy(into)
    for other in others():
        assert_states_agree(found, other.descend(frame.padded, state, radius, GATE), shape)
    gone = (found[:, :, layout.INTENSITY] == 0)[:, :, None].repeat(layout.FIELDS, 2)
    assert (found[gone] == 0).all()


def test_descend_writes_nothing_where_there_are_no_points_and_climbs_beside_it(cuda):
    depth = np.full((1, 2, 64), 100.0)
    signal = np.where(np.arange(64) < 40, 20.0, 0) * np.ones((1, 2, 1))
    signal[:, :, 30:35] = 0                                     # dead pixels at the end of the first block
    state = exact_state(depth + 1, signal * (np.arange(64) < 30))
    into = cuda.array(np.where(np.arange(state.shape[3]) < layout.MARGIN, 7, np.nan).astype(np.float32) + 0 * state)
    cuda.descend(frame_on(cuda, exact_frame(depth, signal, 2).padded), cuda.array(state), 1, GATE, out=into)
    view = layout.crop(cuda.numpy(into), 2, 64)[:, 0]
    assert (view[:, :, 30:] == 0).all()
    np.testing.assert_allclose(view[:, layout.DEPTH, :30], 100, atol=0.01)
    assert (cuda.numpy(into)[..., :layout.MARGIN] == 7).all()   # margins are left as they are


@pytest.mark.parametrize("surfaces", [1, 2, 3])
def test_explain(cuda, surfaces):
    frame = make_frame((3, 33), seed=1)
    state = make_state(frame, surfaces, seed=1)
    found = cuda.numpy(cuda.explain(frame_on(cuda, frame.padded), cuda.array(state)))
    for other in others():
        expected = other.explain(frame.padded, state)
        np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())
    assert surfaces == 1 or all(not np.allclose(found[k], frame.padded.matched) for k in range(surfaces))


def test_points_on_a_plane_that_crosses_the_end_of_the_period_stay_on_it(cuda):
    y, x = np.mgrid[:5, :32]
    depth = (295 + 0.6 * x - 0.4 * y)[None] % T
    lit = np.full(depth.shape, 20.0)
    data, state = frame_on(cuda, exact_frame(depth, lit, 5).padded), cuda.array(exact_state(depth, lit))
    view = layout.crop(cuda.numpy(cuda.descend(data, state, 2, GATE)), 5, 32)[:, 0]
    away = (view[:, layout.DEPTH] - depth[0] + T / 2) % T - T / 2
    np.testing.assert_allclose(away, 0, atol=0.02)
    np.testing.assert_allclose(view[1:-1, layout.SLOPE_COL, 1:-1], 0.6, atol=0.02)
    np.testing.assert_allclose(view[1:-1, layout.SLOPE_ROW, 1:-1], -0.4, atol=0.02)
