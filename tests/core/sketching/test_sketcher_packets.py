"""Frames in packets: to the bit the sketch of their photons."""

import dataclasses

import numpy as np

from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sketching.frame_sketcher import FrameSketcher, sketch_photons
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonGates, PhotonHistograms
from srt3d_ros.core.sketching.sums import MAX_PIXEL_PHOTONS

SENSOR = SensorModel(3, 5, 100, 1e-10, [1, 2, 1])
FREQUENCIES = (1, 4, 30)


def frames(count: int) -> list[PhotonEvents]:
    rng = np.random.default_rng(7)
    sizes = rng.integers(0, 400, count)
    return [PhotonEvents(rng.integers(0, SENSOR.pixels, n, dtype=np.uint32), rng.integers(0, 100, n, dtype=np.uint16),
                         stamp_ns=1_000 * k) for k, n in enumerate(sizes)]


def directly(of: list[PhotonEvents]):
    """The sketch of these frames' photons, stamped as their frame is."""
    sketcher = FrameSketcher(SENSOR, FREQUENCIES)
    for frame in of:
        sketcher.add(frame)
    return dataclasses.replace(sketcher.end_frame(), stamp_ns=of[-1].stamp_ns)


def assert_same(sketch, expected):
    np.testing.assert_array_equal(sketch.sums, expected.sums)           # to the bit
    np.testing.assert_array_equal(sketch.photons, expected.photons)
    assert sketch.stamp_ns == expected.stamp_ns


def sketched(sketcher: FrameSketcher, of: list[PhotonEvents]) -> list:
    sketches = []
    for frame in of:
        half = frame.photons // 2       # a frame may come in packets
        sketcher.add(PhotonEvents(frame.pixel[half:], frame.toa[half:], frame.stamp_ns + 5))
        sketcher.add(PhotonEvents(frame.pixel[:half], frame.toa[:half], frame.stamp_ns))
        sketches.append(sketcher.end_frame())
    return sketches


def test_frames_in_packets_have_the_sketch_of_their_photons_to_the_bit():
    sent = frames(20)
    for sketch, frame in zip(sketched(FrameSketcher(SENSOR, FREQUENCIES), sent), sent, strict=True):
        assert_same(sketch, directly([frame]))


def test_a_frame_has_the_cycles_of_its_packets_and_counts_those_of_gates():
    sensor = SENSOR.replace(cycles=100, gates=GateWords())
    assert [sketch.cycles for sketch in sketched(FrameSketcher(sensor, FREQUENCIES), frames(2))] == [200, 200]
    sketcher = FrameSketcher(sensor, (1, 4), gate=Gate(sensor, 40, 60))
    words = np.full((7, 3, 5), 65_535, np.uint16)
    words[:, 0, 0] = 20, 20, 39, 40, 50, 60, 61
    for packets in (1, 2):
        for _ in range(packets):
            sketcher.add(PhotonGates(words))
        sketch = sketcher.end_frame()
        assert (sketch.cycles, sketch.before[0, 0], sketch.photons[0, 0], sketch.before.sum()) == (
            7 * packets, 3 * packets, 3 * packets, 3 * packets)


def test_cycles_of_histograms_from_which_light_was_subtracted_are_not_known():
    sensor = SENSOR.replace(cycles=100)
    for lowest, cycles in ((0, 100), (-1, 0)):
        counts = np.linspace(lowest, 1, 1500, dtype=np.float32).reshape(3, 5, 100)
        assert sketch_photons(PhotonHistograms(counts), sensor, FREQUENCIES).cycles == cycles


def test_more_photons_than_32_bits_hold_are_a_full_pixel_of_the_same_mean():
    counts = np.zeros((3, 5, 100), np.int32)
    counts[1, 2, 20:80] = 40_000_000
    sketcher = FrameSketcher(SENSOR, FREQUENCIES)
    for packets, seen in ((1, 2_400_000_000), (2, MAX_PIXEL_PHOTONS)):
        for _ in range(packets):
            sketcher.add(PhotonHistograms(counts))
        sketch = sketcher.end_frame()
        assert sketch.photons[1, 2] == seen
        expected = sketch_photons(PhotonHistograms(counts // 1000), SENSOR, FREQUENCIES)
        np.testing.assert_allclose(sketch.z[1, 2], expected.z[1, 2], rtol=1e-5, atol=1e-7)
