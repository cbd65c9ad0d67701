"""Files of more photons than are kept in memory: read packet by packet, they give what they give as a whole."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.core.sketching.sketcher import sketch_photons
from srt3d_ros.datasets import read, recording
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import InvalidInput

SENSOR = SensorModel(16, 24, 200, 5e-11, np.exp(-np.linspace(-2, 3, 11)**2))
FREQUENCIES = (1, 2, 5, 9)
GIVEN = {"bin_width_s": 5e-11, "irf": SENSOR.irf, "fov_deg": 20}


@pytest.fixture(scope="module")
def events():
    return Simulator(StaticScene(SENSOR.range_m(np.full((16, 24), 80.0))), SENSOR, sbr=5, ppp=40).frame(0)[0]


@pytest.fixture(scope="module")
def cube(events):
    counts = np.zeros((SENSOR.pixels, 200), np.uint16)
    np.add.at(counts, (events.pixel, events.toa), 1)
    return counts.reshape(16, 24, 200)


@pytest.fixture
def few_kept(monkeypatch):
    """Files of more than 2000 photons stay files, read in several chunks."""
    monkeypatch.setattr(recording, "MAX_KEPT", 2000)
    monkeypatch.setattr("srt3d_ros.datasets.readers.cubes.CHUNK_BYTES", 5 * 24 * 200 * 2)


@pytest.fixture
def npy(cube, tmp_path):
    np.save(tmp_path / "cube.npy", cube)
    return tmp_path / "cube.npy"


def same(sketch, expected) -> None:
    np.testing.assert_array_equal(sketch.photons, expected.photons)
    np.testing.assert_allclose(sketch.sums, expected.sums, atol=2e-3)


def test_the_sketch_of_many_is_that_of_all_photons(npy, events, few_kept):
    found = read(npy, **GIVEN)
    assert not found.is_loaded and found.photons == events.photons and len(list(found.packets())) == 4
    same(found.sketch(frequencies=FREQUENCIES), sketch_photons(events, SENSOR, FREQUENCIES))
    gated = found.sketch(frequencies=FREQUENCIES, gate=(60, 120))
    same(gated, sketch_photons(events, SENSOR, FREQUENCIES, Gate(SENSOR, 60, 120)))


def test_the_sample_has_all_photons_of_some_pixels_and_all_can_be_had(npy, events, few_kept, monkeypatch):
    found = read(npy, **GIVEN)
    sample, sensor = found.sample
    mask = sensor.mask
    counts = np.bincount(events.pixel, minlength=SENSOR.pixels)
    assert 0 < sample.photons <= 2000
    assert np.array_equal(np.bincount(sample.pixel, minlength=SENSOR.pixels), counts * mask.ravel())
    assert read(npy, **GIVEN).frame.photons == events.photons
    monkeypatch.setattr(recording, "MAX_PHOTONS", 3000)
    with pytest.raises(InvalidInput, match="cube photons is .*at most 3000 in memory"):
        found.frame
    assert np.array_equal(found.source.counts.ravel(), counts)
    assert np.array_equal(found.source.histogram, np.bincount(events.toa, minlength=200))
    changed = found.with_options({"mask": np.eye(16, 24) == 0})
    assert np.array_equal(changed.sketch(1).sensor.mask, np.eye(16, 24) == 0)       # not that of the sample


def test_an_irf_that_cannot_be_seen_is_refused_or_guessed(tmp_path):
    np.save(tmp_path / "even.npy", np.ones((4, 5, 300), np.uint8))
    with pytest.raises(InvalidInput, match="give irf"):
        read(tmp_path / "even.npy", bin_width_s=1e-10)
    guessed = read(tmp_path / "even.npy", bin_width_s=1e-10, guess_irf=True)
    assert guessed.sensor.irf.tolist() == [1] and "one bin" in guessed.notes[0]


def test_negative_and_fractional_counts_are_sketched(cube, tmp_path):
    counts = cube.astype(np.float64) - 0.25
    np.save(tmp_path / "less.npy", counts)
    found = read(tmp_path / "less.npy", **GIVEN)
    assert not found.is_loaded
    expected = counts.reshape(-1, 200) @ np.exp(2j * np.pi * np.outer(np.arange(200), FREQUENCIES) / 200)
    np.testing.assert_allclose(found.sketch(frequencies=FREQUENCIES).sums.reshape(expected.shape), expected, atol=0.02)
    with pytest.raises(InvalidInput, match="counts"):
        read(tmp_path / "less.npy", **GIVEN).frame


def test_a_single_pixel_of_too_many_photons_is_sampled_too(tmp_path, monkeypatch):
    monkeypatch.setattr(recording, "MAX_KEPT", 2000)
    counts = np.zeros((1, 2, 50), np.uint32)
    counts[0, 0, 20:23] = 1_000_000
    np.save(tmp_path / "bright.npy", counts)
    found = read(tmp_path / "bright.npy", bin_width_s=1e-10, irf=np.ones(3))
    assert not found.is_loaded and found.photons == 3_000_000 and 1900 < found.sample[0].photons <= 2000
    assert found.sketch(1).photons.tolist() == [[3_000_000, 0]]
