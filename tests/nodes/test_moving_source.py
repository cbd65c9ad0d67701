"""The player's moving sensor: packets and odometry of one time, whose depths and poses agree."""

from itertools import pairwise

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.datasets.simulation.motion_profiles import OPTICAL, walk
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import cdr
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.nodes.motion_input import parse_extrinsics
from srt3d_ros.nodes.player import PARAMETERS
from srt3d_ros.nodes.sources import BEFORE_S, PACKETS, MovingSource

MS = 1_000_000
BEFORE_NS = round(BEFORE_S * 1e9)


def make(**parameters) -> MovingSource:
    return MovingSource({one.name: one.default for one in PARAMETERS} | {"motion": "walk", "frames": 1} | parameters)


def pose_of(raw: bytes) -> Pose:
    message = deserialize_message(raw, Odometry)
    at, turn = message.pose.pose.position, message.pose.pose.orientation
    return Pose.from_quaternion((turn.x, turn.y, turn.z, turn.w), (at.x, at.y, at.z))


def test_packets_come_when_they_are_acquired_among_odometry_that_covers_them():
    items = list(make(rate_hz=20.0, ppp=2.0).items())
    assert all(before.due_ns <= after.due_ns for before, after in pairwise(items))
    packets = [item for item in items if item.topic == "photons"]
    assert [item.stamp_ns for item in packets] == [BEFORE_NS + k * 5 * MS for k in range(PACKETS)]
    assert [item.due_ns - item.stamp_ns for item in packets] == [5 * MS] * PACKETS
    assert sum(item.photons for item in packets) == pytest.approx(2 * 141 * 141, rel=0.05)
    stamps = [item.stamp_ns for item in items if item.topic == "odom"]
    assert stamps[0] == 0 and stamps[-1] >= BEFORE_NS + 100 * MS and set(np.diff(stamps)) == {10 * MS}


def test_odometry_is_that_of_the_path():
    reports = [item for item in make().items() if item.topic == "odom"]
    assert all(item.due_ns == item.stamp_ns for item in reports)
    for item in reports[::5]:
        pose, exact = pose_of(item.raw), walk((item.stamp_ns - BEFORE_NS) / 1e9)
        np.testing.assert_allclose(pose.translation, exact.translation, atol=1e-12)
        np.testing.assert_allclose(pose.rotation, exact.rotation, atol=1e-12)
    message = deserialize_message(reports[3].raw, Odometry)
    assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")
    speed = message.twist.twist.linear
    assert np.linalg.norm([speed.x, speed.y, speed.z]) == pytest.approx(1, rel=0.03) and speed.x > 0.9
    assert message.twist.twist.angular.z == pytest.approx(np.radians(30), rel=0.03)


def test_the_extrinsics_that_it_tells_are_where_the_sensor_is():
    note, = make().notes
    np.testing.assert_allclose(parse_extrinsics(note.split("'")[-2]).rotation, OPTICAL.rotation, atol=1e-9)


def test_a_file_does_not_move():
    with pytest.raises(InvalidInput, match="motion is walk: expected off"):
        make(input="head.npz")


def test_the_player_sends_both_with_stamps_of_one_clock(graph):
    frames, odometry = graph.collect(PointCloud2, "photons"), graph.collect(Odometry, "odom")
    described = graph.collect_latched(String, "sensor")
    player = graph.start("player", motion="spin", frames=2, rate_hz=5.0, ppp=1.0)
    assert player.code() == 0
    graph.wait(lambda: len(frames) == 2 * PACKETS, "the packets")
    assert sensor_message.decode(described[0]).num_bins == 1024
    stamps = [frame.header.stamp.sec * 10**9 + frame.header.stamp.nanosec for frame in frames]
    assert set(np.diff(stamps)) == {20 * MS}
    graph.wait(lambda: odometry and _ns(odometry[-1]) >= stamps[-1] + 20 * MS, "odometry until the end")
    assert _ns(odometry[0]) <= stamps[0] + 20 * MS
    report = graph.reports("player", "frames_sent", 2 * PACKETS)
    assert int(report["first_stamp_ns"]) == stamps[0]


def _ns(message: Odometry) -> int:
    return message.header.stamp.sec * cdr.NS_PER_S + message.header.stamp.nanosec
