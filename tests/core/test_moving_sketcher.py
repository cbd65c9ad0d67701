"""Frames of a moving sensor: which part a photon belongs to, when parts were, and what becomes of the frame."""

from dataclasses import replace

import numpy as np
import pytest

from srt3d_ros.core import moving_sketcher
from srt3d_ros.core.gate import Gate
from srt3d_ros.core.motion import Pose, Trajectory
from srt3d_ros.core.moving_sketcher import MovingSketcher
from srt3d_ros.core.photons import PhotonEvents, PhotonGates
from srt3d_ros.core.projection import AngularScan
from srt3d_ros.core.scan_rate import ScanRate
from srt3d_ros.core.sensor import GateWords, SensorModel
from srt3d_ros.core.sketching import Sketcher, sketch_photons
from srt3d_ros.errors import InvalidInput

T, STEP = 100, 0.02
SENSOR = SensorModel(3, 12, T, 1e-10, [1, 2, 1], projection=AngularScan(0.1, -STEP, 0.02, -STEP), gates=GateWords())
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


def standing(last_ms: int = 10_000) -> Trajectory:
    trajectory = Trajectory()
    trajectory.add(0, Pose())
    trajectory.add(last_ms * MS, Pose())
    return trajectory


def assert_same(sketch, expected):
    np.testing.assert_array_equal(sketch.photons, expected.photons)
    np.testing.assert_allclose(sketch.sums, expected.sums, atol=0.02)


@pytest.mark.parametrize("order", [(0, 10, 20, 30), (30, 10, 0, 20)])
def test_each_stamp_is_a_part_in_the_middle_of_its_packet(order):
    frame = frame_of(MovingSketcher(SENSOR, FREQUENCIES), order)
    assert instants_ms(frame) == [5, 15, 25, 35]
    assert (frame.first_ns, frame.last_ns, frame.to_ns) == (5 * MS, 35 * MS, 20 * MS)
    for stamp, (_, sketch) in zip((0, 10, 20, 30), frame.parts):
        assert_same(sketch, sketch_photons(photons(stamp * MS), SENSOR, FREQUENCIES))


@pytest.mark.parametrize(("deskew_to", "to_ms"), [("start", 100), ("middle", 120), ("end", 140)])
def test_the_instant_of_a_frame_is_the_one_chosen(deskew_to, to_ms):
    sketcher = MovingSketcher(SENSOR, FREQUENCIES, deskew_to=deskew_to)
    frame = frame_of(sketcher, (100, 110, 120, 130))
    assert frame.to_ns == to_ms * MS
    assert frame.first_ns <= frame.to_ns <= frame.last_ns
    for trajectory in (standing(), None):
        assert sketcher.finish(frame, trajectory).stamp_ns == to_ms * MS


def test_packets_with_one_stamp_are_one_part_and_lost_packets_make_none_longer():
    frame = frame_of(MovingSketcher(SENSOR, FREQUENCIES), (0, 0, 10, 40, 40, 50))
    assert instants_ms(frame) == [5, 15, 45, 55]
    assert [int(sketch.photons.sum()) for _, sketch in frame.parts] == [400, 200, 400, 200]


def test_a_frame_of_one_packet_lasts_until_the_next():
    sketcher = MovingSketcher(SENSOR, FREQUENCIES)
    first, second = (frame_of(sketcher, (stamp,)) for stamp in (0, 100))
    assert (instants_ms(first), first.to_ns) == ([0], 0)            # nothing is known yet
    assert (instants_ms(second), second.to_ns) == ([150], 150 * MS)


def test_of_two_packets_a_frame_and_a_pause_the_pause_is_no_packet():
    sketcher = MovingSketcher(SENSOR, FREQUENCIES)
    for first in (0, 100, 200):
        frame = frame_of(sketcher, (first, first + 10))
    assert instants_ms(frame) == [205, 215] and frame.to_ns == 210 * MS


def test_more_packets_than_parts_share_them_evenly_from_the_second_frame_on():
    sketcher = MovingSketcher(SENSOR, FREQUENCIES, subframes=4)
    first = frame_of(sketcher, range(0, 100, 5))
    assert len(first.parts) == 4 and sum(int(sketch.photons.sum()) for _, sketch in first.parts) == 4_000
    second = frame_of(sketcher, range(100, 200, 5))
    assert instants_ms(second) == [112.5, 137.5, 162.5, 187.5]
    assert [int(sketch.photons.sum()) for _, sketch in second.parts] == [1_000] * 4
    assert instants_ms(frame_of(sketcher, (200, 225, 250, 275)))[0] == 200 + 2.5      # of the last 16 distances


def test_photons_with_times_are_parts_by_these():
    sketcher, events = MovingSketcher(SENSOR, FREQUENCIES, subframes=5), photons(1_000 * MS, number=1_000)
    after = np.arange(1_000) % 100
    sketcher.add(replace(events, t=(after * MS).astype(np.uint32)))
    frame = sketcher.end_frame()
    assert instants_ms(frame) == [1_009.5, 1_029.5, 1_049.5, 1_069.5, 1_089.5]
    assert frame.to_ns == pytest.approx(1_049.5 * MS)
    chosen = after < 20
    part = PhotonEvents(events.pixel[chosen], events.toa[chosen])
    assert_same(frame.parts[0][1], sketch_photons(part, SENSOR, FREQUENCIES))


def test_pixels_with_times_are_one_part_from_the_first_stamp_on():
    sensor = SensorModel(3, 12, T, 1e-10, [1], projection=SENSOR.projection, scan=ScanRate(0, 0.01))
    sketcher = MovingSketcher(sensor, FREQUENCIES)
    for stamp in (20, 0):
        sketcher.add(photons(stamp * MS))
    frame = sketcher.end_frame()
    assert instants_ms(frame) == [0] and (frame.first_ns, frame.last_ns, frame.to_ns) == (0, 110 * MS, 55 * MS)
    assert sketcher.finish(frame, standing()).photons.sum() == 400


def test_a_sensor_that_stands_sees_what_a_sketcher_does():
    sketcher, plain = MovingSketcher(SENSOR, FREQUENCIES), Sketcher(SENSOR, FREQUENCIES)
    for stamp in range(0, 50, 10):
        plain.add(photons(stamp * MS))
    frame = frame_of(sketcher, range(0, 50, 10))
    for trajectory in (standing(), None):
        assert_same(sketcher.finish(frame, trajectory), plain.sketch())
        assert sketcher.lost == 0


def test_a_turning_sensor_brings_the_parts_together():
    """A point seen by pixel 2, 3, 4 …: the sensor turns by a column a packet."""
    trajectory, sketcher = Trajectory(), MovingSketcher(SENSOR, FREQUENCIES, deskew_to="start")
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


def test_gates_are_added_too():
    sketcher, words = MovingSketcher(SENSOR, FREQUENCIES), np.full((2, 3, 12), 65_535, np.uint16)
    words[1, 2, 3] = 7
    sketcher.add(PhotonGates(words, 3 * MS))
    sketch = sketcher.finish(sketcher.end_frame(), standing())
    assert sketch.photons[2, 3] == 1 == sketch.photons.sum()


@pytest.mark.parametrize("make", [lambda bad: bad, lambda bad: replace(bad, t=np.array([0, 50 * MS], np.uint32))])
def test_a_packet_that_is_refused_leaves_no_photon(make):
    sketcher = MovingSketcher(SENSOR, FREQUENCIES)
    with pytest.raises(InvalidInput, match="^toa is 100"):
        sketcher.add(make(PhotonEvents(np.array([0, 1], np.uint32), np.array([5, 100], np.uint16))))
    frame = sketcher.end_frame()
    assert frame.parts == []
    assert sketcher.finish(frame, standing()).photons.sum() == 0


def test_after_a_reset_nothing_of_the_past_remains():
    sketcher = MovingSketcher(SENSOR, FREQUENCIES, window_frames=3)
    sketcher.finish(frame_of(sketcher, (0, 10)), standing())
    sketcher.add(photons(50 * MS))
    sketcher.reset()
    sketch = sketcher.finish(frame_of(sketcher, (100,)), standing())
    assert_same(sketch, sketch_photons(photons(100 * MS), SENSOR, FREQUENCIES))


def test_a_frame_without_motion_begins_the_window_anew():
    sketcher = MovingSketcher(SENSOR, FREQUENCIES, window_frames=3)
    counts = [int(sketcher.finish(frame_of(sketcher, (k * 100,)), trajectory).photons.sum())
              for k, trajectory in enumerate((standing(), standing(), None, standing(), standing()))]
    assert counts == [200, 400, 200, 200, 400]


def test_memory_of_parts_is_used_again():
    sketcher = MovingSketcher(SENSOR, FREQUENCIES, subframes=3)
    for first in range(0, 1_000, 100):
        frame_of(sketcher, range(first, first + 100, 10))
    assert len(sketcher._spare) == 3


@pytest.mark.parametrize(("name", "value"), [("deskew_to", "now"), ("subframes", 0), ("window_frames", 0)])
def test_what_cannot_be_is_refused(name, value):
    with pytest.raises(InvalidInput, match=f"^{name} is"):
        MovingSketcher(SENSOR, FREQUENCIES, **{name: value})


def test_a_window_that_would_not_fit_into_memory_is_refused(monkeypatch):
    monkeypatch.setattr(moving_sketcher, "MAX_WINDOW_BYTES", 100_000)
    with pytest.raises(InvalidInput, match="window_frames is 500: expected 1 to .* for 3 × 12 pixels in 10 subframes"):
        MovingSketcher(SENSOR, FREQUENCIES, 500)
    with pytest.raises(InvalidInput, match="subframes is 500: expected 1 to .*: each takes"):
        MovingSketcher(SENSOR, FREQUENCIES, subframes=500)


def test_a_window_is_no_longer_than_the_trajectory():
    sketcher, known = MovingSketcher(SENSOR, FREQUENCIES, window_frames=5), Trajectory()
    for stamp in range(0, 30_000, 100):
        known.add(stamp * MS, Pose())
        if stamp % 4_000 == 1_000:
            counts = int(sketcher.finish(frame_of(sketcher, (stamp - 500, stamp - 490)), known).photons.sum())
    assert counts == 3 * 400        # of 12 s, those of the last 10 s
