"""The evidence of a pixel's own photons: by formulas that can be written down, and against the oracle."""

import numpy as np
import pytest
from numba import njit

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import DEAD_LIMIT, LIKENESS
from srt3d_ros.kernels.cpu.arithmetic import exp, log
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.cpu.method.likelihood import llr as kernel
from srt3d_ros.kernels.cpu.vectors import full, load, store, total

from .frames import CPU, FAINT, ORACLE, T, make_frame, make_state, make_terms, padded

FRAME = Frame.of(make_frame((6, 40), seed=0))


@njit(error_model="numpy")
def of_numbers(response, photons, expected, frame):
    return total(kernel(full(response), full(photons), full(expected), np.float32(LIKENESS), frame)) / maps.LANES


@njit
def log_and_exp(values, out):
    for first in range(0, len(values), maps.LANES):
        store(out, 0, first, log(load(values, first)))
        store(out, 1, first, exp(-load(values, first)))


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


def test_a_response_against_the_surface_is_none_at_all():
    assert llr(-50, 30, 10) == llr(0, 30, 10) < 0


def test_intensities_within_a_factor_of_two_are_one_surfaces():
    photons, seen = 400, 40
    response = seen * FRAME.total_energy
    free = llr(response, photons, seen)
    assert llr(response, photons, seen * 1.99) == llr(response, photons, seen * 0.51) == free
    assert llr(response, photons, seen * 3) < free and llr(response, photons, seen / 3) < free


@pytest.mark.parametrize(("shape", "surfaces", "light"), [((6, 40), 1, FAINT), ((9, 33), 2, 1), ((6, 40), 4, FAINT)])
def test_log_likelihood_ratio(shape, surfaces, light):
    frame = make_frame(shape, 1, light)
    state = make_state(frame, surfaces, 1, light)
    arguments = padded(frame), state, make_terms(frame, state)
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
