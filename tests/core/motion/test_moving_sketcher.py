"""Frames of a moving sensor: which part a photon belongs to, when parts were, and what becomes of the frame."""

import numpy as np
import pytest

from srt3d_ros.core.motion import moving_sketcher
from srt3d_ros.core.motion.moving_sketcher import MovingSketcher
from srt3d_ros.core.motion.trajectory import Pose, Trajectory
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import AngularScan
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.core.sketching.photon_frame import PhotonEvents

T, STEP = 100, 0.02
SENSOR = SensorModel(3, 12, T, 1e-10, [1, 2, 1], projection=AngularScan(0.1, -STEP, 0.02, -STEP))
FREQUENCIES = (1, 4, 30)
MS = 10**6


def photons(stamp_ns: int, seed: int = 0, number: int = 200) -> PhotonEvents:
    rng = np.random.default_rng((seed, stamp_ns))
    return PhotonEvents(rng.integers(0, SENSOR.pixels, number, dtype=np.uint32),
                        rng.integers(0, T, number, dtype=np.uint16), stamp_ns)


def frame_of(sketcher: MovingSketcher, stamps_ms):
    for stamp in stamps_ms:
        sketcher.add(photons(stamp * MS))
    return sketcher.end_frame()


def instants_ms(frame) -> list[float]:
    return [instant / MS for instant, _ in frame.parts]


def standing() -> Trajectory:
    trajectory = Trajectory()
    trajectory.add(0, Pose())
    trajectory.add(10_000 * MS, Pose())
    return trajectory


def assert_same(sketch, expected):
    np.testing.assert_array_equal(sketch.photons, expected.photons)
    np.testing.assert_allclose(sketch.sums, expected.sums, atol=0.02)


@pytest.mark.parametrize("order", [(0, 10, 20, 30), (30, 10, 0, 20)])
def test_each_stamp_is_a_part_in_the_middle_of_its_packet(order):
    frame = frame_of(MovingSketcher(SENSOR, FREQUENCIES), order)
    assert instants_ms(frame) == [5, 15, 25, 35]
    assert (frame.first_ns, frame.last_ns, frame.stamp_ns) == (5 * MS, 35 * MS, 20 * MS)
    for stamp, (_, sketch) in zip((0, 10, 20, 30), frame.parts):
        assert_same(sketch, sketch_photons(photons(stamp * MS), SENSOR, FREQUENCIES))


def test_packets_with_one_stamp_are_one_part_and_lost_packets_make_none_longer():
    frame = frame_of(MovingSketcher(SENSOR, FREQUENCIES), (0, 0, 10, 40, 40, 50))
    assert instants_ms(frame) == [5, 15, 45, 55]
    assert [int(sketch.photons.sum()) for _, sketch in frame.parts] == [400, 200, 400, 200]


def test_a_frame_of_one_packet_lasts_until_the_next():
    sketcher = MovingSketcher(SENSOR, FREQUENCIES)
    first, second = (frame_of(sketcher, (stamp,)) for stamp in (0, 100))
    assert (instants_ms(first), first.stamp_ns) == ([0], 0)            # nothing is known yet
    assert (instants_ms(second), second.stamp_ns) == ([150], 150 * MS)


def test_of_two_packets_a_frame_and_a_pause_the_pause_is_no_packet():
    sketcher = MovingSketcher(SENSOR, FREQUENCIES)
    for first in (0, 100, 200):
        frame = frame_of(sketcher, (first, first + 10))
    assert instants_ms(frame) == [205, 215] and frame.stamp_ns == 210 * MS


def test_more_packets_than_parts_share_them_evenly_from_the_second_frame_on(monkeypatch):
    monkeypatch.setattr(moving_sketcher, "PARTS", 4)
    sketcher = MovingSketcher(SENSOR, FREQUENCIES)
    first = frame_of(sketcher, range(0, 100, 5))
    assert len(first.parts) == 4 and sum(int(sketch.photons.sum()) for _, sketch in first.parts) == 4_000
    second = frame_of(sketcher, range(100, 200, 5))
    assert instants_ms(second) == [112.5, 137.5, 162.5, 187.5]
    assert [int(sketch.photons.sum()) for _, sketch in second.parts] == [1_000] * 4


def test_a_turning_sensor_brings_the_parts_together():
    """A point seen by pixel 2, 3, 4 …: the sensor turns by a column a packet."""
    trajectory, sketcher = Trajectory(), MovingSketcher(SENSOR, FREQUENCIES)
    for k in range(8):
        trajectory.add(k * 10 * MS - 5 * MS, Pose.turned([0, 0, STEP * k]))
        sketcher.add(PhotonEvents(np.full(10, 2 + k, np.uint32), np.full(10, 50, np.uint16), k * 10 * MS))
    frame = sketcher.end_frame()
    frame = moving_sketcher.MovingFrame(frame.parts[:7], frame.first_ns, 65 * MS, 5 * MS)
    sketch = sketcher.finish(frame, trajectory)
    assert sketch.photons[0, 2] >= 69 and sketch.photons.sum() - sketch.photons[0, 2] <= 1
    assert np.abs(sketch.z[0, 2]).min() > 0.99


def test_photons_outside_the_gate_are_dropped_and_those_inside_counted():
    sketcher = MovingSketcher(SENSOR, (1, 4, 20), gate=Gate(SENSOR, 20, 79))
    sketcher.add(PhotonEvents(np.arange(4, dtype=np.uint32), np.array([10, 30, 40, 90], np.uint16), 0))
    sketcher.add(PhotonEvents(np.arange(4, dtype=np.uint32), np.array([20, 79, 80, 0], np.uint16), MS))
    assert sketcher.kept == 4
    frame = sketcher.end_frame()
    assert sketcher.kept == 0
    assert sketcher.finish(frame, standing()).photons.sum() == 4
