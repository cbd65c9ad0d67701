"""The sketcher of a sensor that moves: frames wait for odometry, and none is lost to what is wrong with it."""

import dataclasses
import signal
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import Vector3
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from rclpy.time import Time
from sensor_msgs.msg import Image, Imu, PointCloud2
from srt3d_ros.nodes.waiting_frames import crowded
from std_msgs.msg import String
from std_srvs.srv import Trigger

from srt3d_ros.core.deskew import moved_ranges
from srt3d_ros.core.gate import Gate, parse
from srt3d_ros.core.motion import Pose, Trajectory
from srt3d_ros.core.moving_sketcher import MovingFrame, MovingSketcher
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.datasets.simulation.motion_profiles import Measured
from srt3d_ros.messages import images
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sketch as sketch_message
from srt3d_ros.nodes import moving_source

PATIENT = str(Path(__file__).with_name("patient") / "sketcher.py")
MS = 1_000_000
START_NS = 1_700_000_000_000 * MS
SPEED_M_S, TURN_RAD_S = np.array([0.3, 0.0, 1.0]), np.array([0.0, 0.5, 0.0])
PACKET_MS, PACKETS = 25, 4
FREQUENCIES = (1, 3)


def pose_at(ms: float) -> Pose:
    return Pose(Pose.turned(TURN_RAD_S * ms / 1e3).rotation, SPEED_M_S * ms / 1e3)


def stamp(message, ms: float, frame_id: str = "odom"):
    message.header.stamp = Time(nanoseconds=START_NS + round(ms * MS)).to_msg()
    message.header.frame_id = frame_id
    return message


def odometry(ms: float, offset_m=(0, 0, 0), body="spad") -> Odometry:
    pose = pose_at(ms)
    moved = Pose(pose.rotation, pose.translation + offset_m)
    message = stamp(moving_source.odometry(Measured(ms / 1e3, moved, SPEED_M_S, TURN_RAD_S)), ms)
    message.child_frame_id = body
    return message


class Moving:
    """A sketcher with motion, and what is sent to it.

    Args:
        node: "sketcher", or PATIENT.
    """

    def __init__(self, graph, sensor, events, node: str = PATIENT, **parameters):
        self.graph, self.sensor = graph, sensor
        self.events = np.array_split(np.random.default_rng(2).permutation(events.photons), PACKETS)
        self.all = events
        self.sketches = graph.collect(PointCloud2, "sketch")
        self.motion = parameters.setdefault("motion", "odom")
        values = {"packets_per_frame": PACKETS, "frequencies": "1,3"}
        # Best effort loses what is sent before the reader, too, has matched: tests send some things once.
        reliable = {f"qos_overrides.{graph.namespace}/{topic}.subscription.reliability": "reliable"
                    for topic in {"odom": ("odom", "depth"), "imu": ("imu",)}[self.motion]}
        self.process = graph.start(node, **values | reliable | parameters).ready()
        graph.introduce(sensor)
        self.photons = graph.matched(graph.publisher(PointCloud2, "photons"))
        self.reports = graph.matched(graph.publisher(Odometry if self.motion == "odom" else Imu, self.motion))

    def packet(self, number: int):
        chosen = np.sort(self.events[number % PACKETS])
        return dataclasses.replace(self.all, pixel=self.all.pixel[chosen], toa=self.all.toa[chosen],
                                   stamp_ns=START_NS + number * PACKET_MS * MS)

    def frame(self, number: int) -> None:
        for packet in range(number * PACKETS, (number + 1) * PACKETS):
            self.photons.publish(photons_message.encode_cdr(self.packet(packet), self.sensor, "spad"))

    def odometry(self, *at_ms: float, **options) -> None:
        for ms in at_ms:
            self.reports.publish(odometry(ms, **options))

    def decoded(self, number: int):
        """The number-th sketch, once it has come."""
        self.graph.wait(lambda: len(self.sketches) > number, f"sketch {number}")
        return sketch_message.decode_cdr(serialize_message(self.sketches[number]), FREQUENCIES, self.sensor)[1]

    def expected(self, number: int, trajectory: Trajectory | None, ranges=None, **options):
        """The core's sketch of a frame after those before it."""
        sketcher = MovingSketcher(self.sensor, FREQUENCIES, **options)
        for packet in range((number + 1) * PACKETS):
            sketcher.add(self.packet(packet))
            if (packet + 1) % PACKETS == 0:
                frame = sketcher.end_frame()
        return sketcher.finish(frame, trajectory, ranges)

    def counts(self, **expected: int) -> dict[str, str]:
        for key, value in expected.items():
            self.graph.reports("sketcher", key, value)
        return self.graph.report("sketcher")

    def told(self, said: str) -> None:
        """Wait until a report of the sketcher has said this."""
        self.graph.wait(lambda: any(said in one["message"] for one in self.graph.all_reports("sketcher")), said)


def trajectory_of(*at_ms: float, extrinsics: Pose | None = None) -> Trajectory:
    trajectory = Trajectory()
    for ms in at_ms:
        trajectory.add(START_NS + ms * MS, pose_at(ms) @ (extrinsics or Pose()))
    return trajectory


def check_same(sketch, expected) -> None:
    assert sketch.stamp_ns == expected.stamp_ns
    apart = sketch.photons.astype(int) - expected.photons       # float32 in an image of depths: one rounds over
    assert np.abs(apart).max() <= 1 >= np.count_nonzero(apart)
    np.testing.assert_allclose(sketch.z, expected.z, atol=2e-4)


AROUND = range(-20, 141, 20)


@pytest.fixture
def start(graph, sensor, events):
    return lambda **parameters: Moving(graph, sensor, events, **parameters)


def test_a_frame_waits_for_the_odometry_that_covers_it_and_is_deskewed_as_the_core_does(start):
    moving = start()
    moving.odometry(*range(-20, 61, 20))
    moving.frame(0)
    report = moving.counts(under_way=PACKETS, packets_open=0)
    assert not moving.sketches and report["photons_under_way"] == str(moving.all.photons)
    moving.odometry(80, 100, 120)
    sketch, wanted = moving.decoded(0), moving.expected(0, trajectory_of(*AROUND))
    check_same(sketch, wanted)
    assert np.abs(wanted.sums - moving.expected(0, None).sums).max() > 1        # the motion can be seen
    report = moving.counts(frames_deskewed=1, under_way=0)
    lost = int(report["photons_dropped.out_of_view"])
    assert 0 < lost < 1000 and int(report["photons"]) == moving.all.photons - lost
    assert abs(int(report["photons"]) - int(wanted.photons.sum())) < 20        # each pixel's share is rounded


def test_late_odometry_and_none_cost_no_frame_and_frames_keep_their_order(start):
    moving = start(node="sketcher")
    moving.frame(0)
    check_same(moving.decoded(0), moving.expected(0, None))         # though nothing else comes
    moving.told("1 frames undeskewed: nothing has come on ")
    moving.odometry(*range(100, 171, 10))
    moving.frame(1)
    moving.frame(2)
    check_same(moving.decoded(1), moving.expected(1, None))
    check_same(moving.decoded(2), moving.expected(2, None))
    moving.odometry(*range(180, 400, 10))
    moving.frame(3)                                     # which is reported on half
    moving.odometry(400, 420)
    check_same(moving.decoded(3), moving.expected(3, trajectory_of(*range(100, 400, 10), 400, 420)))
    report = moving.counts(frames_deskewed=1, frames_undeskewed=3, frames_out=4, under_way=0)
    assert report["dropped"] == "0"
    moving.told("ms older than its end")


def test_what_is_wrong_with_odometry_is_refused_counted_and_told(start):
    moving = start()
    bad = odometry(25)
    bad.pose.pose.position.x = float("nan")
    moving.odometry(0, 20)
    moving.reports.publish(bad)
    moving.reports.publish(odometry(10))                # comes too late
    moving.odometry(40, 60, 80, 100, 120)
    moving.frame(0)
    check_same(moving.decoded(0), moving.expected(0, trajectory_of(*range(0, 121, 20))))
    report = moving.counts(frames_deskewed=1, motion_refused=2, motion_restarts=0)
    assert "/odom: stamp is " in report["last_error"] and "odom: position is " in moving.process.text
    moving.odometry(140, 160, *range(180, 221, 20), offset_m=(2, 0, 0))     # a jump before the frame ends
    moving.frame(1)
    check_same(moving.decoded(1), moving.expected(1, None))             # at once, though the node is patient
    moving.odometry(240, 260, 280, 300, 320, offset_m=(2, 0, 0))
    moving.frame(2)
    report = moving.counts(frames_deskewed=2, frames_undeskewed=1, motion_restarts=1)
    assert "/odom: it jumped by 2.0" in report["last_error"]
    moving.odometry(-90_000)                            # the clock leaps
    moving.odometry(*range(-89_990, -89_800, 20))
    moving.frame(-899)
    report = moving.counts(motion_restarts=2, frames_deskewed=3)
    assert "/odom: stamps fell back by 90." in report["last_error"] and "Traceback" not in moving.process.text


def test_frames_that_wait_go_on_with_a_reset_and_the_end(start, graph):
    moving = start()
    moving.odometry(0, 20)
    for number in range(7):
        moving.frame(number)
    moving.counts(under_way=7 * PACKETS)
    assert graph.call(Trigger, "sketcher/reset", Trigger.Request()).success
    moving.counts(frames_undeskewed=7, under_way=0)
    check_same(moving.decoded(6), moving.expected(6, None))
    moving.odometry(*range(700, 1041, 20))
    for number in (7, 8, 9):
        moving.frame(number)
    moving.counts(frames_deskewed=3)
    check_same(moving.decoded(9), moving.expected(9, trajectory_of(*range(700, 1041, 20))))
    moving.frame(10)
    moving.counts(under_way=PACKETS)
    assert moving.process.end(signal.SIGTERM) == 0
    report = moving.counts(state="finalized", frames_out=11, frames_undeskewed=8)
    assert (report["dropped"], report["under_way"]) == ("0", "0")


def test_a_frame_that_waits_stays_without_the_gate_that_its_photons_ask_for(start, graph):
    moving = start(gate="auto")
    described = graph.collect_latched(String, "sketch/sensor")
    moving.frame(0)
    moving.frame(1)
    moving.counts(under_way=2 * PACKETS)
    moving.odometry(*range(-20, 241, 20))
    graph.wait(lambda: len(moving.sketches) == 2, "both frames")
    (wide, *_), (narrow, *_) = map(sketch_message.decode_sensor, described)
    assert wide.same_as(moving.sensor) and narrow.num_bins < wide.num_bins
    report, trajectory = moving.counts(frames_deskewed=2, under_way=0), trajectory_of(*range(-20, 241, 20))
    check_same(moving.decoded(0), moving.expected(0, trajectory))
    gate = Gate(moving.sensor, *parse(report["gate"].partition(",")[0]))
    check_same(moving.decoded(1), moving.expected(1, trajectory, gate=gate))
    assert int(report["photons_dropped.gate"]) > 1000


def test_more_frames_wait_the_less_memory_they_take():
    def waiting(frames: int, rows: int) -> list[MovingFrame]:
        sums = np.broadcast_to(np.complex64(0), (rows, rows, 10))
        part = 0, Sketch(tuple(range(1, 11)), sums, np.broadcast_to(np.uint32(0), (rows, rows)))
        return [MovingFrame([part] * 10, 0, 0, 0)] * frames

    assert not crowded(waiting(4, 705)) and crowded(waiting(5, 705))
    assert not crowded(waiting(15, 141)) and crowded(waiting(17, 141)) and not crowded(waiting(100, 32))


def test_the_place_of_the_sensor_is_a_parameter_and_the_last_depths_give_parallax(start, graph, sensor):
    text = "0.2 0 0.1 0.5 -0.5 0.5 -0.5"
    extrinsics = Pose.from_quaternion((0.5, -0.5, 0.5, -0.5), (0.2, 0, 0.1))
    moving = start(extrinsics=text)
    depth = np.full((sensor.rows, sensor.cols), 0.75, np.float32)
    graph.matched(graph.publisher(Image, "depth")).publish(images.encode_cdr(depth, START_NS - 10 * MS, "spad"))
    moving.odometry(*AROUND[:-4], body="base_link")
    moving.frame(0)
    moving.counts(under_way=PACKETS)
    reports = len(graph.all_reports("sketcher"))        # which the thread sends that receives the depth image
    graph.wait(lambda: len(graph.all_reports("sketcher")) > reports + 1, "two more reports")
    moving.odometry(*AROUND[-4:], body="base_link")
    trajectory = trajectory_of(*AROUND, extrinsics=extrinsics)
    middle_ns = START_NS + PACKETS * PACKET_MS * MS // 2
    ranges = moved_ranges(depth, sensor, trajectory.motion(START_NS - 10 * MS, middle_ns))
    check_same(moving.decoded(0), moving.expected(0, trajectory, ranges))
    assert moving.decoded(0).stamp_ns == middle_ns
    moving.counts(frames_with_parallax=1)
    assert "extrinsics is empty" not in moving.process.text


@pytest.mark.parametrize(("parameters", "said"), [
    ({"extrinsics": "1 2 3"}, "extrinsics is 1 2 3: expected x y z"),
    ({"window_frames": 3}, "window_frames is 3: expected 1 with motion, which has frames seen from different places")])
def test_what_cannot_go_with_motion_is_refused_in_one_line(graph, parameters, said):
    node = graph.start("sketcher", motion="odom", **parameters)
    assert node.code() == 2 and said in node.text


def test_a_window_is_refused_while_frames_are_deskewed(start, graph):
    moving = start()
    assert graph.set("sketcher", window_frames=3).startswith("window_frames is 3: expected 1 with motion")
    moving.odometry(*AROUND)
    moving.frame(0)
    check_same(moving.decoded(0), moving.expected(0, trajectory_of(*AROUND)))


def test_an_imu_turns_the_frames_of_a_sensor_which_is_taken_to_be_where_it_is_if_nobody_says(start):
    moving = start(motion="imu")
    trajectory = Trajectory()
    for ms in AROUND:
        message = stamp(Imu(angular_velocity=Vector3(y=0.5)), ms, "imu_link")
        moving.reports.publish(message)
        trajectory.add_turn(START_NS + ms * MS, np.array([0, 0.5, 0]))
    moving.frame(0)
    check_same(moving.decoded(0), moving.expected(0, trajectory))
    assert "extrinsics is empty: the sensor is taken to be where the body is that" in moving.process.text
    assert moving.counts(frames_deskewed=1)["motion_restarts"] == "0"
