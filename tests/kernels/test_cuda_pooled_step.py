"""The CUDA kernels `expand` and `pooled_step` against the float64 reference and the CPU kernels."""

import numpy as np
import pytest

from srt3d_ros.kernels import maps

from .frames import GATE, T, assert_states_agree, exact_frame, exact_state, make_frame, make_state, make_terms
from .on_device import frame_on, others


@pytest.mark.parametrize(("shape", "surfaces"), [((6, 40), 1), ((3, 33), 2), ((3, 33), 3)])
def test_expand(cuda, shape, surfaces):
    frame = make_frame(shape, seed=1)
    state = make_state(frame, surfaces, seed=1)
    found = cuda.numpy(cuda.expand(frame_on(cuda, frame.padded), cuda.array(state), cuda.Scratch()))
    for other in others():
        expected = other.expand(frame.padded, state)
        for term in range(maps.TERMS):
            one, two = found[:, :, term], expected[:, :, term]
            np.testing.assert_allclose(one, two, atol=1e-5 * np.abs(two).max(), err_msg=str(term))
    assert (found[(state[:, :, maps.INTENSITY] == 0)[:, :, None].repeat(maps.TERMS, 2)] == 0).all()


@pytest.mark.parametrize(("shape", "surfaces", "sigma", "radius"), [
    ((6, 40), 1, 0.5, 1), ((6, 40), 1, 2.0, 3), ((5, 32), 1, 3.5, 4), ((6, 40), 1, 4.0, 5), ((5, 32), 1, 5.0, 8),
    ((5, 32), 1, 1e3, maps.MARGIN), ((3, 33), 2, 2.0, 3), ((3, 33), 2, 5.0, 8), ((3, 33), 4, 1.0, 2)])
def test_pooled_step(cuda, shape, surfaces, sigma, radius):
    frame = make_frame(shape, seed=1)
    state = make_state(frame, surfaces, seed=1)
    terms = make_terms(frame, state)
    given, shown, into = cuda.array(state), cuda.array(terms), cuda.array(np.zeros_like(state))
    arguments = frame_on(cuda, frame.padded), given, shown, sigma, radius, GATE, cuda.Scratch()
    assert cuda.pooled_step(*arguments, out=into) is into
    assert np.array_equal(cuda.numpy(given), state) and np.array_equal(cuda.numpy(shown), terms)
    found = cuda.numpy(into)
    for other in others():
        assert_states_agree(found, other.pooled_step(frame.padded, state, terms, sigma, radius, GATE), shape)
    gone = (found[:, :, maps.INTENSITY] == 0)[:, :, None].repeat(maps.FIELDS, 2)
    assert (found[gone] == 0).all()


def test_pooled_step_writes_no_points_where_there_are_none_and_steps_beside_them(cuda):
    depth = np.full((1, 2, 64), 100.0)
    signal = np.where(np.arange(64) < 40, 20.0, 0) * np.ones((1, 2, 1))
    signal[:, :, 30:35] = 0                                     # dead pixels at the end of the first block
    frame, state = exact_frame(depth, signal, 2), exact_state(depth + 0.5, signal * (np.arange(64) < 30))
    into = cuda.array(np.where(np.arange(state.shape[3]) < maps.MARGIN, 7, np.nan).astype(np.float32) + 0 * state)
    given = frame_on(cuda, frame.padded), cuda.array(state), cuda.array(make_terms(frame, state))
    cuda.pooled_step(*given, 1.0, 1, GATE, out=into)
    view = maps.crop(cuda.numpy(into), 2, 64)[:, 0]
    assert (view[:, :, 30:] == 0).all()
    np.testing.assert_allclose(view[:, maps.DEPTH, :30], 100, atol=0.01)
    assert (cuda.numpy(into)[..., :maps.MARGIN] == 7).all()   # margins are left as they are


def test_points_on_a_plane_that_crosses_the_end_of_the_period_stay_on_it(cuda):
    y, x = np.mgrid[:5, :32]
    depth = (295 + 0.6 * x - 0.4 * y)[None] % T
    lit = np.full(depth.shape, 20.0)
    frame, state = exact_frame(depth, lit, 5), exact_state(depth, lit)
    given = frame_on(cuda, frame.padded), cuda.array(state), cuda.array(make_terms(frame, state))
    view = maps.crop(cuda.numpy(cuda.pooled_step(*given, 1.0, 2, GATE)), 5, 32)[:, 0]
    away = (view[:, maps.DEPTH] - depth[0] + T / 2) % T - T / 2
    np.testing.assert_allclose(away, 0, atol=0.02)
    np.testing.assert_allclose(view[1:-1, maps.SLOPE_COL, 1:-1], 0.6, atol=0.02)
    np.testing.assert_allclose(view[1:-1, maps.SLOPE_ROW, 1:-1], -0.4, atol=0.02)
