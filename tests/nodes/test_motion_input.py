"""Where the sensor is on its robot, without a node and without tf2_msgs, which has no wheel."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message

from srt3d_ros.core.moving_sketcher import MovingFrame
from srt3d_ros.nodes.motion_input import MotionInput

MS = 1_000_000
UNCONNECTED = "/tf_static does not connect spad to "


class Placed:
    """A MotionInput that follows /tf_static and odometry of a robot at rest, ten reports a time."""

    def __init__(self, sensor, extrinsics: str = "", frame_id: str = "spad"):
        given = {"motion": "odom", "extrinsics": extrinsics, "motion_timeout_s": 0.3}
        self.node, self.reports = Mock(parameters=given), 0
        self.node.make_subscription.return_value.topic_name = "/odom"
        self.node.now_ns.return_value = 0
        self.motion = MotionInput(self.node, moved=lambda: None, wanted=lambda: False)
        if not extrinsics:
            (_, self.transforms), _ = self.node.follow.call_args
        self.report = self.node.make_subscription.call_args_list[0].args[1]
        self.motion.of(sensor, frame_id)

    def tf(self, *tree: tuple[str, str, float], **turn: float) -> None:
        """The x of frames in their parents'."""
        message = SimpleNamespace(transforms=[])
        for parent, child, x in tree:
            transform = Transform(translation=Vector3(x=x), rotation=Quaternion(**turn))
            message.transforms.append(TransformStamped(child_frame_id=child, transform=transform))
            message.transforms[-1].header.frame_id = parent
        self.transforms(message)

    def odometry(self, body: str) -> None:
        for _ in range(10):
            self.reports += 1
            message = Odometry(child_frame_id=body)
            message.header.stamp.nanosec = self.reports * 10 * MS
            self.report(serialize_message(message))
        self.motion.update()

    @property
    def x(self) -> float | str:
        """Where the sensor was during the last reports, or why that is not known."""
        last_ns = self.reports * 10 * MS
        frame = MovingFrame([], last_ns - 50 * MS, last_ns, last_ns)
        trajectory, cause = self.motion.trajectory(frame, None, late=True)
        return cause if trajectory is None else round(float(trajectory.at(last_ns).translation[0]), 9)

    @property
    def told(self) -> list[str]:
        return [call.args[0] for call in self.node.diagnostics.error.call_args_list]


@pytest.fixture
def placed(sensor):
    return Placed(sensor)


def test_tf_static_places_the_sensor_also_by_two_publishers_and_through_frames_between(placed):
    placed.odometry("base_link")
    assert placed.x == UNCONNECTED + "base_link"
    placed.tf(("base_link", "mast", 0.2))
    placed.odometry("base_link")
    assert placed.x == UNCONNECTED + "base_link"
    placed.tf(("mast", "spad", 0.1))
    placed.odometry("base_link")
    assert placed.x == 0.3
    placed.tf(("base_link", "mast", 0.2), ("base_link", "camera", 7.0))
    assert placed.x == 0.3       # said again: the trajectory stays
    assert not placed.told


def test_another_place_begins_another_trajectory_and_is_told(placed):
    for x in (0.25, 0.5):
        placed.tf(("base_link", "spad", x))
        placed.odometry("base_link")
        assert placed.x == x
    assert placed.told == ["/tf_static now has spad at [0.5, 0.0, 0.0] m in base_link; the trajectory begins again"]


@pytest.mark.parametrize("body", ["imu_link", ""])
def test_the_place_in_one_body_is_none_in_another(placed, body):
    placed.tf(("base_link", "spad", 0.25))
    placed.odometry("base_link")
    placed.odometry(body)
    missing = UNCONNECTED + (body or "a body without a name")
    assert placed.x == missing and placed.told == [f"{missing}; the trajectory begins again"]
    placed.odometry("base_link")
    assert placed.x == 0.25


@pytest.mark.parametrize("frame_id", ["spad", ""])
def test_extrinsics_hold_whatever_the_body_and_the_sensor_are_called(sensor, frame_id):
    placed = Placed(replace(sensor, frame_id=""), "0.25 0 0 0 0 0 1", frame_id)
    placed.odometry("")
    assert placed.x == 0.25
    placed.odometry("base_link")
    assert placed.x == 0.25 and not placed.told


def test_what_is_no_transform_is_refused_and_the_last_one_stays(placed):
    placed.tf(("base_link", "spad", 0.25))
    placed.odometry("base_link")
    placed.tf(("base_link", "spad", np.nan))
    placed.tf(("base_link", "spad", 0.5), x=1.0, y=1.0, z=1.0, w=1.0)
    placed.tf(("base_link", "spad", 0.5), w=0.0)
    assert placed.x == 0.25
    assert [one.partition(" is ")[0] for one in placed.told] == [
        "/tf_static, spad: position", "/tf_static, spad: orientation", "/tf_static, spad: orientation"]


def test_a_sensor_without_a_name_is_nowhere(sensor):
    placed = Placed(replace(sensor, frame_id=""), frame_id="")
    placed.tf(("base_link", "spad", 0.25))
    placed.odometry("base_link")
    assert placed.x == "/tf_static does not connect a sensor without a name to base_link"
    placed.motion.of(sensor, "spad")
    placed.odometry("base_link")
    assert placed.x == 0.25
