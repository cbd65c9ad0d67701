"""Sliding windows: to the bit the sketch of their photons, however long they run."""

import dataclasses

import numpy as np
import pytest

from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sketching import frame_sketcher as sketcher_module
from srt3d_ros.core.sketching.frame_sketcher import FrameSketcher, sketch_photons
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonGates, PhotonHistograms
from srt3d_ros.core.sketching.sums import MAX_PIXEL_PHOTONS
from srt3d_ros.errors import InvalidInput

SENSOR = SensorModel(3, 5, 100, 1e-10, [1, 2, 1])
FREQUENCIES = (1, 4, 30)


def frames(count: int) -> list[PhotonEvents]:
    rng = np.random.default_rng(7)
    sizes = rng.integers(0, 400, count)
    return [PhotonEvents(rng.integers(0, SENSOR.pixels, n, dtype=np.uint32), rng.integers(0, 100, n, dtype=np.uint16),
                         stamp_ns=1_000 * k) for k, n in enumerate(sizes)]


def directly(of: list[PhotonEvents]):
    """The sketch of these frames' photons, stamped as their window is."""
    sketcher = FrameSketcher(SENSOR, FREQUENCIES)
    for frame in of:
        sketcher.add(frame)
    return dataclasses.replace(sketcher.end_frame(), stamp_ns=of[-1].stamp_ns)


def assert_same(sketch, expected):
    np.testing.assert_array_equal(sketch.sums, expected.sums)           # to the bit
    np.testing.assert_array_equal(sketch.photons, expected.photons)
    assert sketch.stamp_ns == expected.stamp_ns


def slide(sketcher: FrameSketcher, of: list[PhotonEvents]) -> list:
    sketches = []
    for frame in of:
        half = frame.photons // 2       # a frame may come in packets
        sketcher.add(PhotonEvents(frame.pixel[half:], frame.toa[half:], frame.stamp_ns + 5))
        sketcher.add(PhotonEvents(frame.pixel[:half], frame.toa[:half], frame.stamp_ns))
        sketches.append(sketcher.end_frame())
    return sketches


@pytest.mark.parametrize("width", [1, 2, 50])
def test_a_window_has_the_sketch_of_its_photons_to_the_bit(width):
    sent = frames(20)
    sketcher = FrameSketcher(SENSOR, FREQUENCIES, width)
    for k, sketch in enumerate(slide(sketcher, sent)):
        assert_same(sketch, directly(sent[max(0, k + 1 - width):k + 1]))


def test_a_window_has_the_cycles_of_its_packets_and_counts_those_of_gates():
    sensor = SENSOR.replace(cycles=100, gates=GateWords())
    sketcher = FrameSketcher(sensor, FREQUENCIES, 3)
    assert [sketch.cycles for sketch in slide(sketcher, frames(5))] == [200, 400, 600, 600, 600]
    sketcher = FrameSketcher(sensor, (1, 4), 2, Gate(sensor, 40, 60))
    words = np.full((7, 3, 5), 65_535, np.uint16)
    words[:, 0, 0] = 20, 20, 39, 40, 50, 60, 61
    for cycles in (7, 14, 14):
        sketcher.add(PhotonGates(words))
        sketch = sketcher.end_frame()
        assert (sketch.cycles, sketch.before[0, 0], sketch.photons[0, 0], sketch.before.sum()) == (
            cycles, cycles // 7 * 3, cycles // 7 * 3, cycles // 7 * 3)


def test_cycles_of_histograms_from_which_light_was_subtracted_are_not_known():
    sensor = SENSOR.replace(cycles=100)
    for counts, cycles in ((np.ones((3, 5, 100), np.uint16), 100), (np.ones((3, 5, 100), np.float32), 0)):
        assert sketch_photons(PhotonHistograms(counts), sensor, FREQUENCIES).cycles == cycles


def test_more_photons_than_32_bits_hold_are_a_full_pixel_of_the_same_mean():
    counts = np.zeros((3, 5, 100), np.int32)
    counts[1, 2, 20:80] = 40_000_000
    sketcher = FrameSketcher(SENSOR, FREQUENCIES, 2)
    for seen in (2_400_000_000, MAX_PIXEL_PHOTONS, MAX_PIXEL_PHOTONS):
        sketcher.add(PhotonHistograms(counts))
        sketch = sketcher.end_frame()
        assert sketch.photons[1, 2] == seen
        expected = sketch_photons(PhotonHistograms(counts // 1000), SENSOR, FREQUENCIES)
        np.testing.assert_allclose(sketch.z[1, 2], expected.z[1, 2], rtol=1e-5, atol=1e-7)


def test_a_window_that_would_not_fit_into_memory_is_refused(monkeypatch):
    monkeypatch.setattr(sketcher_module, "MAX_WINDOW_BYTES", 20_000)
    FrameSketcher(SENSOR, FREQUENCIES, 6)
    with pytest.raises(InvalidInput, match="window_frames is 500: expected 1 to 6 for 3 × 5 pixels"):
        FrameSketcher(SENSOR, FREQUENCIES, 500)
    one = dataclasses.replace(SENSOR, rows=300, cols=500)
    assert FrameSketcher(one, FREQUENCIES).window_frames == 1      # that one must always do
