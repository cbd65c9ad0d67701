"""Expansion of the data terms and their pools against the oracle, and what the oracle must do as well."""

import numpy as np
import pytest

from srt3d_ros.kernels import maps

from .frames import (
    CPU,
    GATE,
    ORACLE,
    T,
    assert_states_agree,
    exact_frame,
    exact_state,
    make_frame,
    make_state,
    make_terms,
    padded,
)

FAR = 8                     # a radius with cells
BOTH = pytest.mark.parametrize("kernels", [CPU, ORACLE])


@pytest.mark.parametrize(("shape", "surfaces"), [((6, 40), 1), ((9, 33), 2), ((6, 40), 4)])
def test_expand(shape, surfaces):
    frame = make_frame(shape, seed=1)
    state = make_state(frame, surfaces, seed=1)
    fast, slow = CPU.expand(padded(frame), state), ORACLE.expand(padded(frame), state)
    assert fast.dtype == np.float32 and fast.shape == slow.shape
    for term in range(maps.TERMS):
        one, other = fast[:, :, term], slow[:, :, term]
        np.testing.assert_allclose(one, other, atol=1e-5 * np.abs(other).max(), err_msg=str(term))
    nowhere = (state[:, :, maps.INTENSITY] == 0)[:, :, None].repeat(maps.TERMS, 2)
    assert (fast[nowhere] == 0).all() and (fast[:, :, maps.CURVATURE] > 0).sum() > 50


@BOTH
def test_expand_leaves_out_what_the_other_surfaces_explain(kernels):
    depth = np.concatenate([np.full((1, 3, 40), 100.0), np.full((1, 3, 40), 104.0)])
    photons = np.concatenate([np.full((1, 3, 40), 30.0), np.full((1, 3, 40), 20.0)])
    frame, state = exact_frame(depth, photons, 5), exact_state(depth, photons)
    terms = maps.crop(kernels.expand(padded(frame), state), 3, 40)
    for k, shown in enumerate((30, 20)):
        np.testing.assert_allclose(terms[:, k, maps.VALUE], shown * frame.total_energy, rtol=1e-4)
        np.testing.assert_allclose(terms[:, k, maps.CURVATURE], shown * frame.curvature, rtol=1e-4)
        np.testing.assert_allclose(terms[:, k, maps.GRADIENT], 0, atol=1e-3 * shown * frame.curvature)
    assert (terms[:, :, maps.SQUARES] == 55).all() and (terms[:, :, maps.COUNTS] == 55).all()
    assert (terms[:, :, maps.EXPOSURE] == 1).all()


@pytest.mark.parametrize(("shape", "surfaces"), [((6, 40), 1), ((9, 33), 2), ((6, 40), 4), ((1, 67), 1)])
@pytest.mark.parametrize(("sigma", "radius", "fine"), [
    (0.5, 1, 4), (3.5, 4, 4), (4.0, 5, 4), (2.0, 7, 1), (5.0, FAR, 4), (1e3, maps.MARGIN, 4)])
def test_pooled_step(shape, surfaces, sigma, radius, fine):
    frame = make_frame(shape, seed=1)
    state = make_state(frame, surfaces, seed=1)
    terms = make_terms(frame, state)
    arguments = padded(frame), state, terms, sigma, radius, fine, GATE
    _, before, known, *_ = CPU.changed("pooled_step", *arguments)
    after = CPU.pooled_step(*arguments)
    assert np.array_equal(before, state) and np.array_equal(known, terms) and after.dtype == np.float32
    assert_states_agree(after, ORACLE.pooled_step(*arguments), shape)
    assert not after[:, :, maps.INTENSITY][state[:, :, maps.INTENSITY] == 0].any() and np.isfinite(after).all()


def test_pooled_step_leaves_margins_empty_and_steps_beside_pixels_without_points(backend):
    depth = np.full((1, 2, 64), 100.0)
    signal = np.where(np.arange(64) < 40, 20.0, 0) * np.ones((1, 2, 1))
    signal[:, :, 30:35] = 0                                     # dead pixels at the end of the first block
    frame, state = exact_frame(depth, signal, 2), exact_state(depth + 0.5, signal * (np.arange(64) < 30))
    found = backend.pooled_step(padded(frame), state, make_terms(frame, state), 1.0, 1, 4, GATE)
    view = maps.crop(found, 2, 64)[:, 0]
    assert (view[:, maps.INTENSITY, 30:] == 0).all() and not found[..., :maps.MARGIN].any()
    np.testing.assert_allclose(view[:, maps.DEPTH, :30], 100, atol=0.01)


@BOTH
@pytest.mark.parametrize("radius", [3, FAR])
def test_points_on_a_plane_that_crosses_the_end_of_the_period_stay_on_it(kernels, radius):
    y, x = np.mgrid[:19, :32]
    depth = (295 + 0.6 * x - 0.4 * y)[None] % T
    lit = np.full(depth.shape, 20.0)
    frame, state = exact_frame(depth, lit, 5), exact_state(depth, lit)
    view = maps.crop(state, 19, 32)
    view[:, :, maps.STD] = 1
    state[:] = kernels.pooled_step(padded(frame), state, make_terms(frame, state), 3.0, radius, 4, GATE)   # the slopes
    after = kernels.pooled_step(padded(frame), state, make_terms(frame, state), 3.0, radius, 4, GATE)
    view = maps.crop(after, 19, 32)[:, 0]
    away = (view[:, maps.DEPTH] - depth[0] + T / 2) % T - T / 2
    inner = np.s_[FAR:-FAR, FAR:-FAR]
    np.testing.assert_allclose(away[inner], 0, atol=0.02)
    np.testing.assert_allclose(view[:, maps.SLOPE_COL][inner], 0.6, atol=0.02)
    np.testing.assert_allclose(view[:, maps.SLOPE_ROW][inner], -0.4, atol=0.02)
    np.testing.assert_allclose(view[:, maps.RESIDUAL][inner], 0, atol=0.02)


@BOTH
def test_the_residual_is_the_distance_of_the_neighbours_from_the_plane(kernels):
    """Depths alternate by ± 0.2 bins, from row to row and column to column; less the noise that goes."""
    y, x = np.mgrid[:13, :33]
    depth, lit = (50 + 0.2 * (-1.0)**(x + y))[None], np.full((1, 13, 33), 20.0)
    frame, state = exact_frame(depth, lit, 5), exact_state(depth, lit)
    maps.crop(state, 13, 33)[:, :, maps.STD] = 0.5
    after = kernels.pooled_step(padded(frame), state, make_terms(frame, state), 1e3, 4, 4, GATE)
    point = maps.crop(after, 13, 33)[6, 0, :, 16]
    dy, dx = np.mgrid[-4:5, -4:5]
    inside = dx**2 + dy**2 <= 4 * 5
    close = (1 - 0.4**2 / (2 * GATE * 0.5**2))**2
    other = close * (inside & ((dx + dy) % 2 == 1)).sum()
    mean = 0.4**2 * other / (other + (inside & ((dx + dy) % 2 == 0)).sum())
    gone = 0.5**2 - point[maps.STD]**2
    assert point[maps.RESIDUAL] == pytest.approx(np.sqrt(max(mean - gone, 0)), rel=0.05, abs=0.02)
