"""Frequencies: the IRF's spectrum, and which k are chosen from what a user writes."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequencies import DEFAULT_SKETCH_SIZE, best_frequencies, choose_frequencies, irf_spectrum
from srt3d_ros.errors import InvalidInput


def bell(width: float, length: int = 61) -> np.ndarray:
    return np.exp(-0.5 * ((np.arange(length) - length // 2) / width) ** 2)


def make(num_bins=1000, irf=bell(4), **changes) -> SensorModel:
    return SensorModel(1, 2, num_bins, 1e-10, irf, **changes)


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


@pytest.mark.parametrize(("num_bins", "m"), [(2, 1), (3, 1), (8, 3), (21, 10), (22, 10)])
@pytest.mark.parametrize("spec", ["auto", "consecutive"])
def test_without_a_size_a_short_period_gets_as_many_as_it_has(spec, num_bins, m):
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
