"""The designed frequencies: that the bound is that of the estimator, and that the design makes it small."""


import numpy as np
import pytest

from srt3d_ros.core.matched_frame import Matcher
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequencies import (
    angular_frequencies,
    best_frequencies,
    expected_error_bins,
    irf_spectrum,
    nominal_photons,
)

T = 400
TAIL = np.exp(-0.5 * ((np.arange(60) - 12) / np.where(np.arange(60) < 12, 3, 9))**2)
BELL = np.exp(-0.5 * ((np.arange(41) - 20) / 4.0)**2)


def make(irf=TAIL, num_bins=T, **changes) -> SensorModel:
    return SensorModel(1, 2, num_bins, 1e-10, irf, **changes)


def bound(sensor: SensorModel, frequencies, signal, background) -> np.ndarray:
    spectrum = irf_spectrum(sensor.replace(irf_ref=0), np.arange(sensor.num_bins // 2 + 1))
    return expected_error_bins(spectrum, sensor.num_bins, frequencies, np.atleast_1d(signal), np.atleast_1d(background))


def measured_error(sensor: SensorModel, frequencies, signal: float, background: float) -> float:
    """Mean absolute depth error of the matched filter, by drawing photons."""
    rng = np.random.default_rng(0)
    pixels = int(200_000 / (signal + background)) + 400
    t, omega = T / 2, angular_frequencies(frequencies, T)
    counts = rng.poisson([signal, background], (pixels, 2))
    seen = rng.choice(len(sensor.irf), counts[:, 0].sum(), p=sensor.irf / sensor.irf.sum(dtype=np.float64))
    toa = np.concatenate([t + seen - sensor.irf_ref, rng.integers(0, T, counts[:, 1].sum())])
    pixel = np.concatenate([np.repeat(np.arange(pixels), counts[:, k]) for k in (0, 1)])
    histogram = np.zeros((pixels, T))
    np.add.at(histogram, (pixel, toa.astype(int)), 1)
    sums = histogram @ np.exp(1j * np.outer(np.arange(T), omega))
    grid = np.arange(0, T, 0.25)
    response = (sums * np.conj(irf_spectrum(sensor, frequencies))) @ np.exp(-1j * np.outer(omega, grid))
    return np.abs(grid[response.real.argmax(axis=1)] - t).mean()


@pytest.mark.parametrize(("signal", "background"), [(200, 20), (300, 3000), (8, 80)])
@pytest.mark.parametrize("frequencies", [(1, 2, 3, 5, 7, 10, 15, 22), best_frequencies(make(), 8)])
def test_the_matched_filter_errs_as_much_as_the_bound_says(frequencies, signal, background):
    sensor, photons = make(), (signal, background)
    ratio = measured_error(sensor, frequencies, *photons) / bound(sensor, frequencies, *photons)[0]
    assert 0.9 < ratio < (1.2 if signal > 100 else 4)       # it compares pairs of depths, the filter all of them


@pytest.mark.parametrize("irf", [TAIL, BELL, [1.0]])
def test_with_many_photons_the_bound_is_the_sandwich_variance(irf):
    sensor, frequencies = make(irf), (1, 2, 5, 9, 20)
    moments = Matcher(sensor, frequencies).constants["moments"]
    energy, omega = np.abs(irf_spectrum(sensor, frequencies))**2, angular_frequencies(frequencies, T)
    curvature, s, b = (omega**2 * energy).sum(), 1e5, 3e5
    std = np.sqrt(s * moments[0] + b * moments[1]) / (s * curvature)
    assert bound(sensor, frequencies, s, b)[0] == pytest.approx(np.sqrt(2 / np.pi) * std, rel=0.01)


@pytest.mark.parametrize(("irf", "m"), [(TAIL, 5), (BELL, 2), (BELL, 20), (np.ones(30), 10)])
def test_the_design_errs_no_more_than_consecutive_frequencies(irf, m):
    sensor = make(irf)
    designed, simple = (np.log(bound(sensor, frequencies, *nominal_photons(m))).mean()
                        for frequencies in (best_frequencies(sensor, m), tuple(range(1, m + 1))))
    assert designed <= simple + 0.05


@pytest.mark.parametrize(("num_bins", "m"), [(2, 1), (9, 4), (100, 33), (4613, 1), (4613, 64)])
@pytest.mark.parametrize("width", [0.01, 4.0, 1e6])         # a delta, a bell, no structure at all
def test_designs_are_increasing_and_within_the_band(num_bins, m, width):
    most = max((num_bins - 1) // 2, 1)
    irf = np.exp(-0.5 * ((np.arange(min(num_bins, 61)) - 30) / width)**2) + 1e-30
    chosen = best_frequencies(make(irf, num_bins), m)
    assert len(set(chosen)) == m and sorted(chosen) == list(chosen) and chosen[0] == 1 and chosen[-1] <= most
    assert all(type(k) is int for k in chosen)


@pytest.mark.parametrize(("irf", "m", "expected"), [
    (TAIL, 10, (1, 2, 3, 4, 5, 6, 7, 8, 10, 12)), (BELL, 6, (1, 2, 4, 7, 11, 18)), ([1.0], 4, (1, 7, 25, 79))])
def test_known_designs(irf, m, expected):
    assert best_frequencies(make(irf), m) == expected


def test_of_an_irf_per_pixel_the_typical_one_counts():
    late = [np.roll(np.pad(TAIL, 20), shift) for shift in (-20, 20)]
    sensors = make(np.stack(late)), make(np.pad(TAIL, 20)), make(irf_ref=0)
    assert len({best_frequencies(sensor, 10) for sensor in sensors}) == 1
