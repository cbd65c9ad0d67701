"""Arrays of counts that stay in their file: they give what their photons give as events."""

import numpy as np
import pytest

from srt3d_ros import datasets, from_counts, read
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.core.sketching.photon_frame import PhotonHistograms
from srt3d_ros.datasets import arrays, reading
from srt3d_ros.errors import InvalidInput
from tests.core.scenes import simulate
from tests.photon_forms import as_histograms

SENSOR = SensorModel(16, 24, 200, 5e-11, np.exp(-np.linspace(-2, 3, 11)**2))
FREQUENCIES = (1, 2, 5, 9)
GIVEN = {"toa_offset_bins": 0, "bin_width_s": 5e-11, "irf": SENSOR.irf, "fov_deg": 20}


@pytest.fixture(scope="module")
def events():
    return simulate(np.full((16, 24), 80.0), 5, 40, SENSOR)


@pytest.fixture(scope="module")
def cube(events):
    return as_histograms(events, SENSOR).counts


@pytest.fixture
def npy(cube, tmp_path, monkeypatch):
    """Of more photons than become events."""
    monkeypatch.setattr(arrays, "MAX_KEPT", 2000)
    np.save(tmp_path / "cube.npy", cube)
    return tmp_path / "cube.npy"


def test_the_sketch_of_many_is_that_of_all_photons(npy, events):
    found = read(npy, **GIVEN)
    assert isinstance(found.frame, PhotonHistograms) and found.photons == events.photons
    for gate in (None, Gate(SENSOR, 60, 120)):
        expected = sketch_photons(events, SENSOR, FREQUENCIES, gate)
        sketch = found.sketch(frequencies=FREQUENCIES, gate=str(gate or "off"))
        np.testing.assert_array_equal(sketch.photons, expected.photons)
        np.testing.assert_allclose(sketch.sums, expected.sums, atol=2e-3)


def test_a_gate_and_a_longer_period_are_those_of_the_events(npy, events, monkeypatch):
    found = read(npy, gate=(60, 120), **GIVEN)
    inside = (events.toa >= 60) & (events.toa <= 120)
    assert np.sort(found.events.toa).tolist() == np.sort(events.toa[inside] - 60).tolist()
    assert "lie outside the gate" in found.notes[0]
    assert read(npy, num_bins=300, **GIVEN).events.photons == events.photons
    monkeypatch.setattr(reading, "MAX_EVENTS", 3000)
    with pytest.raises(InvalidInput, match="cube has .* photons, more than the 3000 that can be listed"):
        found.reconstruct(method="xcorr")


def test_the_sample_has_all_photons_of_some_pixels(cube, events, monkeypatch):
    monkeypatch.setattr(arrays, "MAX_KEPT", 2000)
    sample, counts = arrays.sampled(cube), np.bincount(events.pixel, minlength=SENSOR.pixels)
    step = int(np.gcd.reduce(np.unique(sample.pixel)))
    assert 1000 < sample.photons <= 2000 and step > 1
    assert np.array_equal(np.bincount(sample.pixel, minlength=SENSOR.pixels), counts * (np.arange(384) % step == 0))
    bright = np.zeros((1, 2, 50), np.uint32)
    bright[0, 0, 20:23] = 1_000_000
    assert 1900 < arrays.sampled(bright).photons <= 2000        # of a single pixel, too


def test_an_irf_that_cannot_be_seen_is_refused_or_guessed(tmp_path):
    np.save(tmp_path / "even.npy", np.ones((4, 5, 300), np.uint8))
    with pytest.raises(InvalidInput, match="give irf"):
        read(tmp_path / "even.npy", bin_width_s=1e-10)
    guessed = datasets.read(tmp_path / "even.npy", bin_width_s=1e-10, guess_irf=True)
    assert guessed.sensor.irf.tolist() == [1] and "one bin" in guessed.notes[0]


def test_negative_and_fractional_counts_are_sketched(cube, tmp_path):
    counts = cube.astype(np.float64) - 0.25
    np.save(tmp_path / "less.npy", counts)
    found = read(tmp_path / "less.npy", **GIVEN)
    expected = counts.reshape(-1, 200) @ np.exp(2j * np.pi * np.outer(np.arange(200), FREQUENCIES) / 200)
    np.testing.assert_allclose(found.sketch(frequencies=FREQUENCIES).sums.reshape(expected.shape), expected, atol=0.02)
    with pytest.raises(InvalidInput, match="histograms is negative or fractional"):
        found.events


@pytest.mark.parametrize("scale", [1 / 255, 1, 10])
def test_counts_that_were_scaled_are_noted(cube, scale):
    notes = " ".join(from_counts((cube * scale).astype(np.float32), **GIVEN).notes)
    assert (f"multiples of {scale:.4g}:" in notes) == (scale != 1)
