"""`odom` and `imu`: what a message says of the motion, and which are refused in one line."""

import math

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Vector3
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages.odometry import decode_imu, decode_odometry

FRAMES = ("", "odometry", "a_frame")        # of three lengths, after which numbers are aligned


def odometry(frame: str = "body") -> Odometry:
    message = Odometry(child_frame_id=frame)
    message.header.stamp, message.header.frame_id = Time(sec=5, nanosec=7), frame
    position, half = message.pose.pose.position, math.sqrt(0.5)
    position.x, position.y, position.z = 1.0, 2.0, 3.0
    message.pose.pose.orientation = Quaternion(z=half, w=half)
    message.pose.covariance[:] = np.arange(36.0)
    return message


def imu(frame: str = "body") -> Imu:
    message = Imu(angular_velocity=Vector3(x=0.1, y=-0.2, z=0.3))
    message.header.stamp, message.header.frame_id = Time(sec=5, nanosec=7), frame
    message.orientation_covariance[0] = -1.0        # an IMU that knows no orientation
    return message


@pytest.mark.parametrize("frame", FRAMES)
def test_where_a_body_was_and_how_fast_it_turned(frame):
    report = decode_odometry(serialize_message(odometry(frame)))
    assert (report.stamp_ns, report.frame_id) == (5_000_000_007, frame)
    np.testing.assert_allclose(report.pose(np.array([1.0, 0, 0])), [1, 3, 3])
    report = decode_imu(serialize_message(imu(frame)))
    assert (report.stamp_ns, report.pose) == (5_000_000_007, None)
    np.testing.assert_array_equal(report.rate_rad_s, [0.1, -0.2, 0.3])


@pytest.mark.parametrize("decode, message, field, value, said", [
    (decode_odometry, odometry, "pose.pose.position.y", math.nan, "position is"),
    (decode_odometry, odometry, "pose.pose.orientation.w", math.nan, "orientation is"),
    (decode_odometry, odometry, "pose.pose.orientation.w", 0.0, "expected a quaternion of length 1"),
    (decode_imu, imu, "angular_velocity.z", math.nan, "angular_velocity is"),
    (decode_imu, imu, "angular_velocity.z", 200.0, "expected at most 35 rad/s"),
])
def test_what_cannot_be_is_refused(decode, message, field, value, said):
    made = part = message()
    *parts, name = field.split(".")
    for inner in parts:
        part = getattr(part, inner)
    setattr(part, name, value)
    with pytest.raises(InvalidInput, match=said):
        decode(serialize_message(made))


def test_an_imu_without_a_rate_and_what_breaks_off_are_refused():
    message = imu()
    message.angular_velocity_covariance[0] = -1.0
    with pytest.raises(InvalidInput, match="angular_velocity_covariance is -1"):
        decode_imu(serialize_message(message))
    for decode, raw in ((decode_odometry, serialize_message(odometry())), (decode_imu, serialize_message(imu()))):
        for length in range(0, len(raw), 9):
            with pytest.raises(InvalidInput):
                decode(raw[:length])
