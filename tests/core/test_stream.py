"""SketchStream: every packet and photon comes out in a sketch, or is dropped for a cause."""

from dataclasses import replace

import numpy as np
import pytest

from srt3d_ros.core import stream as stream_module
from srt3d_ros.core.motion.track import MotionReport
from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import FrameSketcher
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.core.stream import MOTION_S, SketchStream, StreamOptions
from srt3d_ros.errors import InvalidInput
from tests.core.scenes import assert_same_sketch

T, MS, START_NS = 100, 1_000_000, 1_700_000_000_000_000_000
SENSOR = SensorModel(4, 5, T, 1e-10, np.exp(-0.5 * ((np.arange(9) - 4) / 1.5) ** 2))
BY_NUMBER = StreamOptions(frequencies="1,4,30")


def packet(ms: float, photons: int = 60) -> PhotonEvents:
    """Photons in random pixels and bins, always the same at an instant."""
    rng = np.random.default_rng(round(ms * 1000) + 10**6)
    return PhotonEvents(rng.integers(0, SENSOR.pixels, photons, dtype=np.uint32),
                        rng.integers(0, T, photons, dtype=np.uint16), START_NS + round(ms * MS))


def directly(*ms: float):
    sketcher = FrameSketcher(SENSOR, (1, 4, 30))
    for one in ms:
        sketcher.add(packet(one))
    return sketcher.end_frame()


def push(stream: SketchStream, *ms: float, now_s: float | None = None) -> list:
    return [sketch for one in ms for sketch in stream.push(packet(one), one / 1000 if now_s is None else now_s)]


def stamps_ms(sketches) -> list[float]:
    return [(sketch.stamp_ns - START_NS) / MS for sketch in sketches]


def test_packets_make_frames_and_sketches_name_their_sensor():
    stream = SketchStream(SENSOR, BY_NUMBER)
    sketches = push(stream, 0, 10)
    assert stamps_ms(sketches) == [0, 10]
    assert_same_sketch(sketches[1], directly(10))
    assert sketches[0].sensor.same_as(SENSOR)
    assert stream.counts.totals == {"photons_in": 120, "packets": 2, "photons": 120} and not +stream.counts.dropped
    stream = SketchStream(SENSOR, replace(BY_NUMBER, packets_per_frame=2))
    first, second = push(stream, *range(0, 40, 10))
    assert_same_sketch(second, directly(20, 30))
    assert stamps_ms([first, second]) == [0, 20]


def test_silence_ends_a_frame_by_period_when_polled():
    stream = SketchStream(SENSOR, replace(BY_NUMBER, frame_period_ns=100 * MS))
    assert push(stream, 0, 20) == []
    assert stream.poll(0.47) == []
    sketch, = stream.poll(0.53)
    assert_same_sketch(sketch, directly(0, 20))
    assert stream.poll(99) == []


def test_stamps_that_leap_or_a_reset_drop_the_open_frame():
    stream = SketchStream(SENSOR, replace(BY_NUMBER, packets_per_frame=3))
    assert len(push(stream, 0, 10, 20, 30, 40)) == 1
    sketch, = push(stream, 60_000, 60_010, 60_020)
    assert_same_sketch(sketch, directly(60_000, 60_010, 60_020))
    assert +stream.counts.dropped == {"incomplete": 2} and stream.counts.totals["stamp_leaps"] == 1
    stream = SketchStream(SENSOR, replace(BY_NUMBER, packets_per_frame=2))
    push(stream, 0, 10, 20)
    assert stream.reset() == [] and +stream.counts.dropped == {"incomplete": 1}
    assert_same_sketch(push(stream, 30, 40)[0], directly(30, 40))


def test_a_packet_that_is_refused_changes_nothing():
    stream = SketchStream(SENSOR, replace(BY_NUMBER, frame_period_ns=100 * MS))
    push(stream, 0, 50)
    stranger = PhotonEvents(np.array([0, 99], np.uint32), np.array([1, 2], np.uint16), START_NS + 110 * MS)
    with pytest.raises(InvalidInput, match="pixel is 99"):
        stream.push(stranger)
    sketch, = push(stream, 70, 120)
    assert_same_sketch(sketch, directly(0, 50, 70))


@pytest.mark.parametrize(("options", "left"), [({"packets_per_frame": 3}, 0), ({"frame_period_ns": 10**9}, 1)])
def test_flush_ends_what_does_not_wait_for_its_number(options, left):
    stream = SketchStream(SENSOR, replace(BY_NUMBER, **options))
    assert push(stream, 0, 10) == []
    sketches = stream.flush()
    assert len(sketches) == left and stream.counts.dropped["incomplete"] == 2 * (1 - left)
    assert all(sketch.photons.sum() == 120 for sketch in sketches)


# ---- Motion

MOVING = replace(BY_NUMBER, packets_per_frame=4, moving=True)
TURN = np.array([0, 0.5, 0])


def report(ms: float) -> MotionReport:
    return MotionReport(START_NS + round(ms * MS), Pose.turned(TURN * ms / 1e3))


def test_frames_wait_for_the_motion_and_go_on_in_their_order():
    stream = SketchStream(SENSOR, MOVING)
    assert push(stream, 0, 25, 50, 75, 100, 125, 150, 175) == [] and stream.waits_for_motion
    for ms in range(-20, 110, 10):
        assert stream.add_motion(report(ms)) == ""
    first, = stream.poll(0.2)
    assert stamps_ms([first]) == [50]                  # the middle of the frame
    for ms in range(110, 220, 10):
        stream.add_motion(report(ms))
    assert stamps_ms(stream.poll(0.25)) == [150]
    assert stream.counts.totals["frames_deskewed"] == 2 and stream.warning == "" and not stream.waits_for_motion
    assert stream.counts.totals["photons"] + stream.counts.photons_dropped["out_of_view"] == 480


@pytest.mark.parametrize(("reports", "why"), [
    ((), "no motion was reported"),
    (range(-20, 40, 10), "the newest report of motion is 58 ms older than the frame's end"),
    (range(40, 120, 10), "the reports of motion begin within the frame")])
def test_without_its_motion_a_frame_goes_on_undeskewed_and_says_why(reports, why):
    stream = SketchStream(SENSOR, MOVING)
    for ms in reports:
        stream.add_motion(report(ms))
    sketches = push(stream, 0, 25, 50, 75) or stream.poll(0.07 + MOTION_S) or stream.poll(0.08 + MOTION_S)
    assert_same_sketch(sketches[0], directly(0, 25, 50, 75))
    assert stream.warning == why and stream.counts.totals["frames_undeskewed"] == 1


def test_frames_that_wait_are_bounded_in_memory(monkeypatch):
    monkeypatch.setattr(stream_module, "MOST_BYTES", 0)
    stream = SketchStream(SENSOR, MOVING)
    sketches = push(stream, *range(0, 600, 25), now_s=0.0)      # 6 frames; 4 may wait in any case
    assert len(sketches) == 2 and len(stream.flush()) == 4
