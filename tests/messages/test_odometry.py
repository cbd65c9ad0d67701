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

NAN = math.nan


@pytest.fixture(params=["", "odometry", "a_frame"])     # of three lengths, after which numbers are aligned
def frame(request) -> str:
    return request.param


@pytest.fixture
def odometry(frame) -> Odometry:
    message = Odometry(child_frame_id=frame)
    message.header.stamp, message.header.frame_id = Time(sec=5, nanosec=7), frame
    position, half = message.pose.pose.position, math.sqrt(0.5)
    position.x, position.y, position.z = 1.0, 2.0, 3.0
    message.pose.pose.orientation = Quaternion(z=half, w=half)
    message.pose.covariance[:] = np.arange(36.0)
    message.twist.twist.linear, message.twist.twist.angular = Vector3(x=3.0, y=4.0), Vector3(z=0.25)
    return message


@pytest.fixture
def imu(frame) -> Imu:
    message = Imu(angular_velocity=Vector3(x=0.1, y=-0.2, z=0.3))
    message.header.stamp, message.header.frame_id = Time(sec=5, nanosec=7), frame
    message.orientation_covariance[0] = -1.0        # an IMU that knows no orientation
    return message


def test_odometry_says_where_and_how_fast_a_body_was(odometry, frame):
    report = decode_odometry(serialize_message(odometry))
    assert (report.stamp_ns, report.frame_id, report.speed_m_s) == (5_000_000_007, frame, 5.0)
    np.testing.assert_allclose(report.pose(np.array([1.0, 0, 0])), [1, 3, 3])
    np.testing.assert_array_equal(report.rate_rad_s, [0, 0, 0.25])


def test_an_imu_says_how_fast_it_turns(imu, frame):
    report = decode_imu(serialize_message(imu))
    assert (report.stamp_ns, report.frame_id, report.pose) == (5_000_000_007, frame, None)
    np.testing.assert_array_equal(report.rate_rad_s, [0.1, -0.2, 0.3])


def test_a_twist_of_nan_is_none_and_the_pose_is_used(odometry):
    odometry.twist.twist.angular.x = NAN
    report = decode_odometry(serialize_message(odometry))
    assert report.speed_m_s == 0 and not report.rate_rad_s.any() and report.pose.translation[0] == 1


@pytest.mark.parametrize("field, value, said", [
    ("position.y", NAN, "position is"), ("position.x", math.inf, "position is"), ("position.x", 1e300, "position is"),
    ("orientation.w", NAN, "orientation is"), ("orientation.w", 0.0, "expected a quaternion of length 1"),
])
def test_a_pose_that_is_none_is_refused(odometry, field, value, said):
    part, name = field.split(".")
    setattr(getattr(odometry.pose.pose, part), name, value)
    with pytest.raises(InvalidInput, match=said):
        decode_odometry(serialize_message(odometry))


@pytest.mark.parametrize("rate, said", [(NAN, "angular_velocity is"), (200.0, "expected at most 35 rad/s")])
def test_a_rate_that_no_gyroscope_measures_is_refused(imu, rate, said):
    imu.angular_velocity.z = rate
    with pytest.raises(InvalidInput, match=said):
        decode_imu(serialize_message(imu))
    imu.angular_velocity_covariance[0] = -1.0
    with pytest.raises(InvalidInput, match="angular_velocity_covariance is -1"):
        decode_imu(serialize_message(imu))


def test_what_breaks_off_is_refused(odometry, imu):
    for decode, message in ((decode_odometry, odometry), (decode_imu, imu)):
        raw = serialize_message(message)
        for length in range(0, len(raw), 9):
            with pytest.raises(InvalidInput):
                decode(raw[:length])
