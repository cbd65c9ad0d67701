"""`odom` and `imu` → MotionReport: the few fields needed of serialised nav_msgs/Odometry and sensor_msgs/Imu."""

import math

import numpy as np

from srt3d_ros.core.motion.track import MotionReport
from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.errors import require
from srt3d_ros.messages.cdr import Header, Reader

MAX_M = 1e9                 # largest coordinate: far outside of any map, and its square is finite
MAX_RAD_S = 35.0            # 2000 degrees a second, the range of common gyroscopes
COVARIANCE, ROTATION_COVARIANCE = 36, 9
UNKNOWN = -1.0              # first number of the covariance of a quantity that is not measured (sensor_msgs/Imu)


def decode_odometry(raw: bytes) -> MotionReport:
    """The report of a serialised Odometry: its pose.

    Raises:
        InvalidInput: the message is cut off, or its pose is impossible.
    """
    reader = Reader(raw)
    header = reader.members(Header, "header.")
    reader.text("child_frame_id")
    x, y, z, *quaternion = reader.numbers("pose", 7)
    require(all(abs(value) <= MAX_M for value in (x, y, z)), "position", [x, y, z], "finite metres")      # NaN fails
    reader.numbers("pose.covariance", COVARIANCE)
    reader.numbers("twist", 6 + COVARIANCE)
    reader.end()
    return MotionReport(header.stamp_ns, Pose.from_quaternion(quaternion, (x, y, z)), frame_id=header.frame_id)


def decode_imu(raw: bytes) -> MotionReport:
    """The report of a serialised Imu: its rate of turn.

    Raises:
        InvalidInput: the message is cut off, or its rate is not measured or impossible.
    """
    reader = Reader(raw)
    header = reader.members(Header, "header.")
    reader.numbers("orientation", 4 + ROTATION_COVARIANCE)
    rate = reader.numbers("angular_velocity", 3)
    variance, *_ = reader.numbers("angular_velocity_covariance", ROTATION_COVARIANCE)
    reader.numbers("linear_acceleration", 3 + ROTATION_COVARIANCE)
    reader.end()
    require(variance != UNKNOWN, "angular_velocity_covariance", variance, "an IMU that measures its rate of turn")
    # NaN fails this comparison, too.
    require(math.hypot(*rate) <= MAX_RAD_S, "angular_velocity", list(rate), f"at most {MAX_RAD_S:g} rad/s")
    return MotionReport(header.stamp_ns, rate_rad_s=np.array(rate))
