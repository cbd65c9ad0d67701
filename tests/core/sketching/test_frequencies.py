"""Frequencies: the IRF's spectrum, which k are chosen from what a user writes, and that the design errs least."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequencies import (
    DEFAULT_SKETCH_SIZE,
    angular_frequencies,
    best_frequencies,
    choose_frequencies,
    expected_error_bins,
    irf_spectrum,
    nominal_photons,
)
from srt3d_ros.errors import InvalidInput

T = 400
TAIL = np.exp(-0.5 * ((np.arange(60) - 12) / np.where(np.arange(60) < 12, 3, 9))**2)
BELL = np.exp(-0.5 * ((np.arange(41) - 20) / 4.0)**2)


def make(num_bins=1000, irf=BELL, **changes) -> SensorModel:
    return SensorModel(1, 2, num_bins, 1e-10, irf, **changes)


def tailed(irf=TAIL, num_bins=T, **changes) -> SensorModel:
    return make(num_bins, irf, **changes)


def test_spectrum_of_a_delta_is_the_phase_of_its_distance_from_the_reference():
    irf = np.array([[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 5]])
    sensor = SensorModel(1, 3, 20, 1e-10, irf, irf_ref=1)
    expected = np.exp(2j * np.pi * np.outer([0, -1, 2], [1, 3]) / 20)
    np.testing.assert_allclose(irf_spectrum(sensor, (1, 3)), expected, atol=1e-7)
    np.testing.assert_allclose(irf_spectrum(sensor.replace(irf=irf[2]), (1, 3)), expected[2], atol=1e-7)


def test_choices():
    assert choose_frequencies("consecutive", make()) == tuple(range(1, DEFAULT_SKETCH_SIZE + 1)) == tuple(range(1, 11))
    assert choose_frequencies("consecutive", make(), 4) == (1, 2, 3, 4)
    assert choose_frequencies("auto", make(), 6) == best_frequencies(make(), 6)
    assert choose_frequencies("1, 2,5", make()) == (1, 2, 5)
    assert choose_frequencies("5,1", make(), 2) == (5, 1) and len(choose_frequencies("auto", make(), 64)) == 64
    for num_bins, m in ((2, 1), (3, 1), (8, 3), (21, 10), (22, 10)):        # a short period gets as many as it has
        for spec in ("auto", "consecutive"):
            assert choose_frequencies(spec, make(num_bins, [1.0])) == tuple(range(1, m + 1))


@pytest.mark.parametrize(("spec", "m", "num_bins", "named"), [
    ("", None, 100, "frequencies is empty"), ("fast", None, 100, "frequencies is fast"),
    ("1,,2", None, 100, "frequencies is 1,,2"), ("1.5,2", None, 100, "frequencies is 1.5,2"),
    ("1,50", None, 100, "frequencies is 50"), ("1,2,5", 2, 100, "sketch_size is 2: expected 3"),
    ("auto", 0, 100, "sketch_size is 0: expected 1 to 49 for T = 100"), ("consecutive", 50, 100, "sketch_size is 50"),
    ("auto", 65, 1000, "sketch_size is 65: expected 1 to 64"),
    (",".join(map(str, range(1, 66))), None, 1000, "sketch size is 65")])
def test_what_means_nothing_is_refused_by_name(spec, m, num_bins, named):
    with pytest.raises(InvalidInput, match=f"^{named}"):
        choose_frequencies(spec, make(num_bins=num_bins), m)


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
@pytest.mark.parametrize("frequencies", [(1, 2, 3, 5, 7, 10, 15, 22), best_frequencies(tailed(), 8)])
def test_the_matched_filter_errs_as_much_as_the_bound_says(frequencies, signal, background):
    sensor, photons = tailed(), (signal, background)
    ratio = measured_error(sensor, frequencies, *photons) / bound(sensor, frequencies, *photons)[0]
    assert 0.9 < ratio < (1.2 if signal > 100 else 4)       # it compares pairs of depths, the filter all of them


@pytest.mark.parametrize(("irf", "m"), [(TAIL, 5), (BELL, 2), (BELL, 20), (np.ones(30), 10)])
def test_the_design_errs_no_more_than_consecutive_frequencies(irf, m):
    sensor = tailed(irf)
    designed, simple = (np.log(bound(sensor, frequencies, *nominal_photons(m))).mean()
                        for frequencies in (best_frequencies(sensor, m), tuple(range(1, m + 1))))
    assert designed <= simple + 0.05


@pytest.mark.parametrize(("num_bins", "m"), [(2, 1), (9, 4), (100, 33), (4613, 1), (4613, 64)])
@pytest.mark.parametrize("width", [0.01, 4.0, 1e6])         # a delta, a bell, no structure at all
def test_designs_are_increasing_and_within_the_band(num_bins, m, width):
    most = max((num_bins - 1) // 2, 1)
    irf = np.exp(-0.5 * ((np.arange(min(num_bins, 61)) - 30) / width)**2) + 1e-30
    chosen = best_frequencies(tailed(irf, num_bins), m)
    assert len(set(chosen)) == m and sorted(chosen) == list(chosen) and chosen[0] == 1 and chosen[-1] <= most
    assert all(type(k) is int for k in chosen)


@pytest.mark.parametrize(("irf", "m", "expected"), [
    (TAIL, 10, (1, 2, 3, 4, 5, 6, 7, 8, 10, 12)), (BELL, 6, (1, 2, 4, 7, 11, 18)), ([1.0], 4, (1, 7, 25, 79))])
def test_known_designs(irf, m, expected):
    assert best_frequencies(tailed(irf), m) == expected


def test_of_an_irf_per_pixel_the_typical_one_counts():
    late = [np.roll(np.pad(TAIL, 20), shift) for shift in (-20, 20)]
    sensors = tailed(np.stack(late)), tailed(np.pad(TAIL, 20)), tailed(irf_ref=0)
    assert len({best_frequencies(sensor, 10) for sensor in sensors}) == 1
