"""Simulated motions of a sensor inside `room.Room`, smooth and endless, and their odometry.

Frames follow REP-103 and REP-105: `odom` is fixed, z up, the origin in the middle of the floor; the body has x forward,
y left, z up.
"""

from collections.abc import Callable, Iterator
from itertools import count, pairwise
from typing import NamedTuple

import numpy as np

from srt3d_ros.core.motion.trajectory import Pose

Path = Callable[[float], Pose]          # the pose at a time, s

SPEED_M_S, TURN_RAD_S = 1.0, np.radians(30)
WALK_RADIUS_M = SPEED_M_S / TURN_RAD_S  # 1.9 m
LAP_S = 2 * np.pi / TURN_RAD_S          # 12 s, after which a motion repeats
EYE_M = 1.5                             # above the floor
STEPS_HZ = 22 / LAP_S                   # 1.8, as of a walking person
OPTICAL = Pose(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]))     # of a camera looking ahead, in the body's frame


def walk(t_s: float) -> Pose:
    """Walk in a circle at 1 m/s and 30°/s, looking slightly down and bobbing."""
    angle, step = TURN_RAD_S * t_s, 2 * np.pi * STEPS_HZ * t_s
    place = np.array([WALK_RADIUS_M * np.cos(angle), WALK_RADIUS_M * np.sin(angle), EYE_M + 0.02 * np.sin(step)])
    yaw = Pose.turned([0, 0, angle + np.pi / 2])
    pitch = Pose.turned([0, np.radians(8 + 0.5 * np.sin(step)), 0])
    roll = Pose.turned([np.radians(np.sin(step / 2)), 0, 0])
    return Pose((yaw @ pitch @ roll).rotation, place)


MOTIONS: dict[str, Path] = {"walk": walk}       # of a body in the room


class Measured(NamedTuple):
    """An odometry report: time in s, pose of the body in the fixed frame, velocity and turn rate until the next report
    in the body's frame, float64 [3] each."""

    at_s: float
    pose: Pose
    velocity_m_s: np.ndarray
    rate_rad_s: np.ndarray


def measured(path: Path, rate_hz: float = 100.0, start_s: float = 0.0) -> Iterator[Measured]:
    """Yield exact odometry of a path at `rate_hz` from start_s, without end."""
    for at_s, next_s in pairwise(start_s + k / rate_hz for k in count()):
        pose = path(at_s)
        moved = pose.inverse() @ path(next_s)
        yield Measured(at_s, pose, moved.translation * rate_hz, moved.rotation_vector * rate_hz)
