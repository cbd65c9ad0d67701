"""`odom` and `imu`: nav_msgs/Odometry of a pose, and MotionReports of serialised Odometry and sensor_msgs/Imu."""

import math
from typing import TYPE_CHECKING

import numpy as np

from srt3d_ros.core.motion.track import MotionReport
from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.errors import require
from srt3d_ros.messages.cdr import Header, Reader

if TYPE_CHECKING:
    from nav_msgs.msg import Odometry

FIXED_FRAME, BODY_FRAME = "odom", "base_link"       # of what is simulated (REP-105)
MAX_M = 1e9                 # largest coordinate: far outside of any map, and its square is finite
MAX_RAD_S = 35.0            # 2000 degrees a second, the range of common gyroscopes
COVARIANCE, ROTATION_COVARIANCE = 36, 9
UNKNOWN = -1.0              # first number of the covariance of a quantity that is not measured (sensor_msgs/Imu)


def encode_odometry(pose: Pose) -> "Odometry":
    """The message, without a stamp, of the pose of BODY_FRAME in FIXED_FRAME; its twist is 0."""
    from nav_msgs.msg import Odometry

    message = Odometry(child_frame_id=BODY_FRAME)
    message.header.frame_id = FIXED_FRAME
    at, turn = message.pose.pose.position, message.pose.pose.orientation
    at.x, at.y, at.z = pose.translation.tolist()
    turn.x, turn.y, turn.z, turn.w = pose.quaternion
    return message


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
