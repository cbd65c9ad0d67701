"""Expansion of the data terms and their pools against the oracle, and what the oracle must do as well."""

import numpy as np
import pytest
from numba import njit

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import DEAD_LIMIT, LIKENESS
from srt3d_ros.kernels.cpu.arithmetic import exp, log
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.cpu.method.likelihood import llr as kernel
from srt3d_ros.kernels.cpu.spans import span
from srt3d_ros.kernels.cpu.vectors import full, total

from .frames import (
    CPU,
    FAINT,
    GATE,
    ORACLE,
    T,
    assert_states_agree,
    exact_frame,
    exact_state,
    make_frame,
    make_terms,
    padded,
    setting,
)

FAR = 8                     # a radius with cells


@pytest.mark.parametrize(("shape", "surfaces"), [((6, 40), 1), ((9, 33), 2), ((6, 40), 4)])
def test_expand(shape, surfaces):
    frame, state, _ = setting(shape, surfaces, seed=1)
    fast, slow = CPU.expand(padded(frame), state), ORACLE.expand(padded(frame), state)
    assert fast.dtype == np.float32 and fast.shape == slow.shape
    for term in range(maps.TERMS):
        one, other = fast[:, :, term], slow[:, :, term]
        np.testing.assert_allclose(one, other, atol=1e-5 * np.abs(other).max(), err_msg=str(term))
    nowhere = (state[:, :, maps.INTENSITY] == 0)[:, :, None].repeat(maps.TERMS, 2)
    assert (fast[nowhere] == 0).all() and (fast[:, :, maps.CURVATURE] > 0).sum() > 50


def test_expand_leaves_out_what_the_other_surfaces_explain(backend):
    depth = np.concatenate([np.full((1, 3, 40), 100.0), np.full((1, 3, 40), 104.0)])
    photons = np.concatenate([np.full((1, 3, 40), 30.0), np.full((1, 3, 40), 20.0)])
    frame, state = exact_frame(depth, photons, 5), exact_state(depth, photons)
    terms = maps.crop(backend.expand(padded(frame), state), 3, 40)
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
    frame, state, terms = setting(shape, surfaces, seed=1)
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


@pytest.mark.parametrize("radius", [3, FAR])
def test_points_on_a_plane_that_crosses_the_end_of_the_period_stay_on_it(backend, radius):
    y, x = np.mgrid[:19, :32]
    depth = (295 + 0.6 * x - 0.4 * y)[None] % T
    lit = np.full(depth.shape, 20.0)
    frame, state = exact_frame(depth, lit, 5), exact_state(depth, lit)
    view = maps.crop(state, 19, 32)
    view[:, :, maps.STD] = 1
    state[:] = backend.pooled_step(padded(frame), state, make_terms(frame, state), 3.0, radius, 4, GATE)   # the slopes
    after = backend.pooled_step(padded(frame), state, make_terms(frame, state), 3.0, radius, 4, GATE)
    view = maps.crop(after, 19, 32)[:, 0]
    away = (view[:, maps.DEPTH] - depth[0] + T / 2) % T - T / 2
    inner = np.s_[FAR:-FAR, FAR:-FAR]
    np.testing.assert_allclose(away[inner], 0, atol=0.02)
    np.testing.assert_allclose(view[:, maps.SLOPE_COL][inner], 0.6, atol=0.02)
    np.testing.assert_allclose(view[:, maps.SLOPE_ROW][inner], -0.4, atol=0.02)
    np.testing.assert_allclose(view[:, maps.RESIDUAL][inner], 0, atol=0.02)


def test_the_residual_is_the_distance_of_the_neighbours_from_the_plane(backend):
    """Depths alternate by ± 0.2 bins, from row to row and column to column; less the noise that goes."""
    y, x = np.mgrid[:13, :33]
    depth, lit = (50 + 0.2 * (-1.0)**(x + y))[None], np.full((1, 13, 33), 20.0)
    frame, state = exact_frame(depth, lit, 5), exact_state(depth, lit)
    maps.crop(state, 13, 33)[:, :, maps.STD] = 0.5
    after = backend.pooled_step(padded(frame), state, make_terms(frame, state), 1e3, 4, 4, GATE)
    point = maps.crop(after, 13, 33)[6, 0, :, 16]
    dy, dx = np.mgrid[-4:5, -4:5]
    inside = dx**2 + dy**2 <= 4 * 5
    close = (1 - 0.4**2 / (2 * GATE * 0.5**2))**2
    other = close * (inside & ((dx + dy) % 2 == 1)).sum()
    mean = 0.4**2 * other / (other + (inside & ((dx + dy) % 2 == 0)).sum())
    gone = 0.5**2 - point[maps.STD]**2
    assert point[maps.RESIDUAL] == pytest.approx(np.sqrt(max(mean - gone, 0)), rel=0.05, abs=0.02)


FRAME = Frame.of(make_frame((6, 40), seed=0))


@njit(error_model="numpy")
def of_numbers(response, photons, expected, frame):
    return total(kernel(full(response), full(photons), full(expected), np.float32(LIKENESS), frame)) / maps.LANES


@njit
def log_and_exp(values, out):
    for first in range(0, len(values), maps.LANES):
        at = span(first)
        out[0, at], out[1, at] = log(values[at]), exp(-values[at])


def llr(response: float, photons: float, expected: float) -> float:
    return float(of_numbers(*map(np.float32, (response, photons, expected)), FRAME))


def chernoff(mean_response: float) -> float:
    """max_λ λu − log E exp(λ · response), over background photons, which fall on any bin; nats per photon."""
    t = np.arange(0, T, 0.1)
    amplitudes = np.sqrt(FRAME.energy.astype(float))[:, None]       # some spectrum with these energies: all in phase
    response = (amplitudes * np.cos(2 * np.pi * FRAME.bin_frequencies.astype(float)[:, None] * t)).sum(axis=0)
    tilt = np.linspace(0, 60 / response.max(), 4_000)[:, None]
    return float((tilt[:, 0] * mean_response - np.log(np.exp(tilt * response).mean(axis=1))).max())


def test_a_pixel_without_photons_speaks_against_a_surface_but_may_be_dead():
    # Half the deviance of 0 photons where at least half of the expected ones should be: that many nats.
    for expected in (1e-6, 0.1, 0.8):
        background = max(0.5 - expected / 2, 0) * FRAME.intensity_moments[1]
        signal = expected / 2 * FRAME.intensity_moments[0]
        assert llr(0, 0, expected) == pytest.approx(-expected / 2 * signal / (signal + background), rel=1e-5)
    # It may be dead: it speaks no more against the surface than a birth needs. A pixel that has seen photons is not.
    assert llr(0, 0, 2.5) == llr(0, 0, 1e6) == pytest.approx(-DEAD_LIMIT)
    assert llr(0, 1, 1000) == pytest.approx(-500, rel=1e-5)


@pytest.mark.parametrize("share", [0.1, 0.3, 0.6])
def test_rarity_is_chernoffs_bound(share):
    photons, u = 20, share * FRAME.max_response
    certain = llr(photons * u, photons, photons * u / FRAME.total_energy)
    assert certain == pytest.approx(photons * chernoff(u), rel=0.05)


@pytest.mark.parametrize(("photons", "expected"), [(1, 0.3), (1, 200), (30, 5), (1_000, 200)])
def test_more_response_is_more_evidence(photons, expected):
    # Up to where the table of rarity ends; signal responds with total_energy / greatest_response of the most at best.
    response = np.linspace(0, 0.98 * photons * FRAME.max_response, 300)
    gain = np.array([llr(value, photons, expected) for value in response])
    assert (np.diff(gain) > 0).all() and gain[0] < 0
    assert gain[-1] > 1 or expected > 10 * photons


def test_a_response_against_the_surface_is_none_and_intensities_within_a_factor_of_two_are_one_surfaces():
    assert llr(-50, 30, 10) == llr(0, 30, 10) < 0
    photons, seen = 400, 40
    response = seen * FRAME.total_energy
    free = llr(response, photons, seen)
    assert llr(response, photons, seen * 1.99) == llr(response, photons, seen * 0.51) == free
    assert llr(response, photons, seen * 3) < free and llr(response, photons, seen / 3) < free


@pytest.mark.parametrize(("shape", "surfaces", "light"), [((6, 40), 1, FAINT), ((9, 33), 2, 1), ((6, 40), 4, FAINT)])
def test_log_likelihood_ratio(shape, surfaces, light):
    frame, state, terms = setting(shape, surfaces, 1, light)
    arguments = padded(frame), state, terms
    fast, slow = (kernels.log_likelihood_ratio(*arguments) for kernels in (CPU, ORACLE))
    np.testing.assert_allclose(fast, slow, atol=1e-5 * np.abs(slow).max())
    assert (fast > 1).any() and (fast < -0.5).any()
    assert (fast[state[:, :, maps.INTENSITY] == 0] == 0).all()


def test_logarithm_and_exponential_function():
    values = np.geomspace(1e-30, 1e30, 1_024, dtype=np.float32)
    found = np.empty((2, len(values)), np.float32)
    log_and_exp(values, found)
    np.testing.assert_allclose(found[0], np.log(values.astype(float)), rtol=4e-7, atol=4e-7)
    np.testing.assert_allclose(found[1], np.exp(-values.astype(float)), rtol=1e-5, atol=2e-38)


@pytest.mark.parametrize(("shape", "surfaces"), [((6, 40), 1), ((9, 33), 2), ((6, 40), 4)])
def test_solve_pairs(shape, surfaces):
    frame, state, terms = setting(shape, surfaces, seed=1)
    (_, before, fast), (*_, slow) = (kernels.changed("solve_pairs", padded(frame), state, terms)
                                     for kernels in (CPU, ORACLE))
    assert np.array_equal(before, state) and (fast != terms).any() == (surfaces > 1)
    for term in range(maps.TERMS):
        np.testing.assert_allclose(fast[:, :, term], slow[:, :, term], atol=1e-5 * np.abs(slow[:, :, term]).max())


def test_surfaces_whose_pulses_overlap_are_solved_for_together(backend):
    """From 1 bin and a fifth of the light off. In turns, the second one's step is 2.2 bins, its light 17 % off."""
    depth, light, off = np.array([100.0, 113]), np.array([30.0, 20]), np.array([1.0, -1])
    each = np.ones((2, 3, 40))
    frame = exact_frame(depth[:, None, None] * each, light[:, None, None] * each, 5)
    state = exact_state((depth + off)[:, None, None] * each, (light * (1 + off / 5))[:, None, None] * each)
    solved = backend.changed("solve_pairs", padded(frame), state, make_terms(frame, state))[2]
    value, slope = (maps.crop(solved, 3, 40)[0, :, term, 0] for term in (maps.VALUE, maps.GRADIENT))
    np.testing.assert_allclose(slope / frame.curvature / light, -off, atol=0.1)
    np.testing.assert_allclose(value / frame.total_energy, light, rtol=0.05)
