"""The designed frequencies: that the bound is that of the estimator, and that the design makes it small."""

import numpy as np
import pytest

from srt3d_ros.core.frequencies import angular_frequencies, consecutive, irf_spectrum, spread
from srt3d_ros.core.frequency_design import (
    BEND_OF_MANY,
    MOST_OCTAVES,
    PLENTY,
    ROOM,
    design,
    expected_error_bins,
    highest_passed,
    nominal_photons,
    progression,
)
from srt3d_ros.core.matched_frame import Matcher
from srt3d_ros.core.sensor import SensorModel

T = 400
TAIL = np.exp(-0.5 * ((np.arange(60) - 12) / np.where(np.arange(60) < 12, 3, 9))**2)
EDGE = np.exp(-np.arange(80) / 20) + 12 * (np.arange(80) < 2)        # a sharp edge and a long tail
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


@pytest.mark.parametrize(("signal", "background"), [(200, 20), (300, 3000), (15, 15), (8, 80)])
@pytest.mark.parametrize("rule", [lambda sensor: consecutive(8), lambda sensor: spread(sensor, 8),
                                  lambda sensor: design(sensor, 8)])
def test_the_matched_filter_errs_as_much_as_the_bound_says(rule, signal, background):
    sensor = make()
    photons = (signal, background)
    ratio = measured_error(sensor, rule(sensor), *photons) / bound(sensor, rule(sensor), *photons)[0]
    assert 0.9 < ratio < (1.2 if signal > 100 else 4)       # it compares pairs of depths, the filter all of them


@pytest.mark.parametrize("irf", [TAIL, BELL, [1.0]])
def test_with_many_photons_the_bound_is_the_sandwich_variance(irf):
    sensor, frequencies = make(irf), (1, 2, 5, 9, 20)
    matcher = Matcher(sensor, frequencies)
    energy, omega = np.abs(irf_spectrum(sensor, frequencies))**2, angular_frequencies(frequencies, T)
    curvature, s, b = (omega**2 * energy).sum(), 1e5, 3e5
    std = np.sqrt(s * matcher.moments[0] + b * matcher.moments[1]) / (s * curvature)
    assert bound(sensor, frequencies, s, b)[0] == pytest.approx(np.sqrt(2 / np.pi) * std, rel=0.01)


def test_depths_that_look_alike_count_as_far_as_they_lie_apart():
    sensor = make([1.0])
    many = bound(sensor, (10,), 1e4, 0)[0]          # ten depths look the same
    assert many > 0.4 * T / 2 and bound(sensor, (1, 10), 1e4, 0)[0] < 1


@pytest.mark.parametrize("irf", [TAIL, BELL, np.ones(30)])
@pytest.mark.parametrize("m", [2, 5, 10, 20])
def test_the_design_errs_no_more_than_the_simple_rules(irf, m):
    sensor = make(irf)
    errors = [np.log(bound(sensor, frequencies, *nominal_photons(m))).mean()
              for frequencies in (design(sensor, m), spread(sensor, m), consecutive(m))]
    assert errors[0] <= min(errors[1:]) + 0.05


@pytest.mark.parametrize(("num_bins", "m"), [(2, 1), (3, 1), (4, 1), (9, 1), (9, 2), (9, 4), (100, 1), (100, 33),
                                             (4613, 1), (4613, 2), (4613, 10), (4613, 64)])
@pytest.mark.parametrize("width", [0.01, 4.0, 1e6])         # a delta, a bell, no structure at all
def test_designs_are_increasing_and_within_the_band(num_bins, m, width):
    most = max((num_bins - 1) // 2, 1)
    irf = np.exp(-0.5 * ((np.arange(min(num_bins, 61)) - 30) / width)**2) + 1e-30
    chosen = design(make(irf, num_bins), m)
    assert len(chosen) == m and chosen[0] == 1 and all(b > a for a, b in zip(chosen, chosen[1:])) and chosen[-1] <= most
    assert all(type(k) is int for k in chosen)


@pytest.mark.parametrize(("irf", "m", "expected"), [
    (TAIL, 10, (1, 2, 3, 4, 5, 6, 7, 8, 10, 12)), (BELL, 6, (1, 2, 4, 7, 11, 18)), ([1.0], 4, (1, 7, 25, 79))])
def test_known_designs(irf, m, expected):
    assert design(make(irf), m) == expected


def test_known_errors_and_photons():
    np.testing.assert_allclose(bound(make(BELL), (1, 5, 20), [20, 200], [5, 100]), [0.964146, 0.310322], rtol=1e-5)
    signal, background = nominal_photons(10)
    np.testing.assert_allclose(signal, [26.95, 55, 4.9, 10, 2.695, 5.5])
    np.testing.assert_allclose(background, [269.5, 550, 4.9, 10, 0.2695, 0.55])


def test_a_response_as_wide_as_the_period_leaves_consecutive_frequencies():
    assert design(make(np.ones(T)), 5) == (1, 2, 3, 4, 5)


def test_the_same_response_gets_the_same_design_wherever_it_begins():
    assert design(make(), 10) == design(make(irf_ref=0), 10) == design(make(np.append(np.zeros(9), TAIL)), 10)


def test_of_an_irf_per_pixel_the_typical_one_counts():
    late = [np.roll(np.pad(TAIL, 20), shift) for shift in (-20, 20)]
    assert design(make(np.stack(late)), 10) == design(make(np.pad(TAIL, 20)), 10)


@pytest.mark.parametrize(("top", "m", "expected"), [(1, 1, (1,)), (9, 1, (1,)), (5, 5, (1, 2, 3, 4, 5)),
                                                    (50, 2, (1, 50)), (64, 4, (1, 6, 21, 64))])
def test_progressions(top, m, expected):
    assert progression(top, m) == expected


@pytest.mark.parametrize("m", range(1, 65, 7))
def test_progressions_end_at_the_top(m):
    for top in range(m, 3 * m + 5):
        assert m == 1 or progression(top, m)[-1] == top


@pytest.mark.parametrize("irf", [EDGE, TAIL, BELL])
@pytest.mark.parametrize("m", [5, 10, 20])
def test_with_more_photons_frequencies_rise(irf, m):
    tops = [design(make(irf, 2000), m, octaves, confirmed=1000)[-1] for octaves in range(MOST_OCTAVES + 1)]
    assert tops == sorted(tops) and tops[-1] <= max(highest_passed(make(irf, 2000)), m)
    assert tops[-1] > 1.1 * tops[0] or tops[-1] == highest_passed(make(irf, 2000)) or m == 20


def test_many_photons_of_a_sharp_edge_with_a_tail_get_its_high_frequencies():
    sensor = make(EDGE, 2000)
    few, many = design(sensor, 10), design(sensor, 10, 4, confirmed=1000)
    assert many[-1] > 3 * few[-1]
    errors = [bound(sensor, frequencies, 133, 67)[0] for frequencies in (few, many)]     # of four pixels, 50 each
    assert errors[1] < 0.6 * errors[0]


def test_frequencies_rise_no_higher_than_the_photons_confirm():
    sensor = make(EDGE, 2000)
    few = design(sensor, 10)
    assert design(sensor, 10, 8, confirmed=0) == few == design(sensor, 10, 8, confirmed=int(ROOM * few[-1]))
    assert few[-1] < design(sensor, 10, 8, confirmed=2 * few[-1])[-1] <= 2 * few[-1]


@pytest.mark.parametrize("octaves", [-5, 0])
def test_few_photons_keep_the_design_for_few(octaves):
    assert design(make(EDGE, 2000), 10, octaves, confirmed=1000) == design(make(EDGE, 2000), 10)


def test_beyond_most_octaves_nothing_changes():
    sensor = make(EDGE, 2000)
    assert design(sensor, 10, 50, confirmed=1000) == design(sensor, 10, MOST_OCTAVES, confirmed=1000)


def test_photons_of_more_octaves_are_of_higher_scores():
    m = 10
    signal, background = nominal_photons(m, 4)
    scores = (signal * np.sqrt(2 * m / (signal + background))).reshape(3, -1)
    np.testing.assert_allclose(scores, [[7, 10, 10 * 2**0.5, 20, 20 * 2**0.5, 40]] * 3)


def test_many_photons_spread_more_evenly():
    sensor = make(EDGE, 2000)
    two, three = (design(sensor, 10, octaves, confirmed=1000) for octaves in (PLENTY - 1, PLENTY))
    assert two == progression(two[-1], 10) and three == progression(three[-1], 10, BEND_OF_MANY)
