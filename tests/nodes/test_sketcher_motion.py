"""The sketcher of a sensor that moves: frames wait for odometry, and none is lost to what is wrong with it."""

import dataclasses

import numpy as np
import pytest
from geometry_msgs.msg import Point, Quaternion, Vector3
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rclpy.time import Time
from sensor_msgs.msg import Image, Imu, PointCloud2
from std_srvs.srv import Trigger

from srt3d_ros.core.motion import Pose, Trajectory
from srt3d_ros.core.moving_sketcher import MovingSketcher
from srt3d_ros.core.range_guide import moved_ranges
from srt3d_ros.messages import images
from srt3d_ros.messages import photons as photons_message
from srt3d_ros.messages import sketch as sketch_message

MS = 1_000_000
START_NS = 1_700_000_000_000 * MS
SPEED_M_S, TURN_RAD_S = np.array([0.3, 0.0, 1.0]), np.array([0.0, 0.5, 0.0])
PACKET_MS, PACKETS = 25, 4
FREQUENCIES = (1, 3)
PATIENT_S = 10.0            # for odometry that comes


def pose_at(ms: float) -> Pose:
    return Pose(Pose.turned(TURN_RAD_S * ms / 1e3).rotation, SPEED_M_S * ms / 1e3)


def quaternion(pose: Pose) -> Quaternion:
    vector = pose.rotation_vector
    angle = np.linalg.norm(vector)
    x, y, z = vector / max(angle, 1e-12) * np.sin(angle / 2)
    return Quaternion(x=x, y=y, z=z, w=np.cos(angle / 2))


def stamp(message, ms: float, frame_id: str = "odom"):
    message.header.stamp = Time(nanoseconds=START_NS + round(ms * MS)).to_msg()
    message.header.frame_id = frame_id
    return message


def odometry(ms: float, offset_m=(0, 0, 0), body="spad") -> Odometry:
    message, pose = stamp(Odometry(child_frame_id=body), ms), pose_at(ms)
    x, y, z = (pose.translation + offset_m).tolist()
    message.pose.pose.position, message.pose.pose.orientation = Point(x=x, y=y, z=z), quaternion(pose)
    message.twist.twist.linear = Vector3(**dict(zip("xyz", SPEED_M_S.tolist())))
    message.twist.twist.angular = Vector3(**dict(zip("xyz", TURN_RAD_S.tolist())))
    return message


class Moving:
    """A sketcher with motion, and what is sent to it."""

    def __init__(self, graph, sensor, events, **parameters):
        self.graph, self.sensor = graph, sensor
        self.events = np.array_split(np.random.default_rng(2).permutation(events.photons), PACKETS)
        self.all = events
        self.sketches = graph.collect(PointCloud2, "sketch")
        self.motion = parameters.setdefault("motion", "odom")
        values = {"packets_per_frame": PACKETS, "frequencies": "1,3", "motion_timeout_s": PATIENT_S, "gap_s": 10.0}
        self.process = graph.start("sketcher", **values | parameters).ready()
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


def trajectory_of(*at_ms: float, extrinsics: Pose | None = None) -> Trajectory:
    trajectory = Trajectory()
    for ms in at_ms:
        trajectory.add(START_NS + ms * MS, pose_at(ms) @ (extrinsics or Pose()))
    return trajectory


def check_same(sketch, expected) -> None:
    assert sketch.stamp_ns == expected.stamp_ns
    np.testing.assert_array_equal(sketch.photons, expected.photons)
    np.testing.assert_allclose(sketch.sums, expected.sums, atol=2e-3)


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
    lost = moving.all.photons - int(wanted.photons.sum())
    assert (report["photons_dropped.out_of_view"], report["photons"]) == (str(lost), str(int(wanted.photons.sum())))
