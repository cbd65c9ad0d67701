"""How a simulated sensor moves: poses over time, exact, and as odometry measures them.

Frames follow REP-103 and REP-105: `odom` is fixed, x and y level, z up, the origin in the middle of the floor; the body
moves in it, x forward, y left, z up. All motions are smooth, begin in motion and go on for ever inside `room.Room`.
"""

from collections.abc import Callable, Iterator
from itertools import count, pairwise
from typing import NamedTuple

import numpy as np

from srt3d_ros.core.motion import SMOOTH_NS, Pose, Trajectory
from srt3d_ros.errors import require

Path = Callable[[float], Pose]          # the pose at a time, s

SPEED_M_S, TURN_RAD_S = 1.0, np.radians(30)
WALK_RADIUS_M = SPEED_M_S / TURN_RAD_S  # of the circle on which both hold: 1.9 m
EYE_M = 1.5                             # above the floor
STEPS_HZ = 1.8                          # of a walking person
GRAVITY_M_S2 = 9.81
SHAKE_RAD_S = 2 * np.pi                 # of a hand: once a second
DRIFTS_S = 0.5                          # over which errors of the velocity are alike
OPTICAL = Pose(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]))     # of a camera that looks ahead, in the body's frame


def walk(t_s: float) -> Pose:
    """A person who walks round in a circle at 1 m/s, so turns at 30°/s, looks a little down, and bobs."""
    angle, step = TURN_RAD_S * t_s, 2 * np.pi * STEPS_HZ * t_s
    place = (WALK_RADIUS_M * np.cos(angle), WALK_RADIUS_M * np.sin(angle), EYE_M + 0.02 * np.sin(step))
    return _heading(place, angle + np.pi / 2, np.radians(8 + 0.5 * np.sin(step)), np.radians(np.sin(step / 2)))


def drone(t_s: float) -> Pose:
    """A drone that flies loops at up to 1.2 m/s, rises and sinks, turns at 10 to 40°/s, and banks as it accelerates."""
    rates = 2 * np.pi / np.array([11.0, 8.0, 7.0])
    reach, middle, phase = np.array([1.5, 1.1, 0.35]), np.array([0, 0, 1.5]), np.array([0, 1.3, 0.5])
    place = middle + reach * np.sin(rates * t_s + phase)
    acceleration = -reach * rates**2 * np.sin(rates * t_s + phase)
    yaw = np.radians(25) * t_s + np.radians(15) * np.sin(t_s)
    forward = acceleration[0] * np.cos(yaw) + acceleration[1] * np.sin(yaw)
    left = acceleration[1] * np.cos(yaw) - acceleration[0] * np.sin(yaw)
    return _heading(place, yaw, forward / GRAVITY_M_S2, -left / GRAVITY_M_S2)


def spin(t_s: float) -> Pose:
    """A robot that turns on the spot at 30°/s, its body frame 0.2 m ahead of the axis."""
    yaw = TURN_RAD_S * t_s
    return _heading((0.2 * np.cos(yaw), 0.2 * np.sin(yaw), EYE_M), yaw)


def hand(t_s: float) -> Pose:
    """A hand that shakes about the origin: 1 m/s and 30°/s at every instant, within 0.16 m and 4.8°."""
    cosine, sine = np.cos(SHAKE_RAD_S * t_s), np.sin(SHAKE_RAD_S * t_s)
    turn = TURN_RAD_S / SHAKE_RAD_S * np.array([0, cosine, sine])       # of the speed named, to 0.1 %
    place = SPEED_M_S / SHAKE_RAD_S * np.array([cosine, 0.8 * sine, 0.6 * sine])
    return Pose(Pose.turned(turn).rotation, place)


MOTIONS: dict[str, Path] = {"walk": walk, "drone": drone, "spin": spin}     # of a body in the room


def _heading(place, yaw: float, pitch: float = 0.0, roll: float = 0.0) -> Pose:
    """At a place, turned to the left by yaw, then down by pitch, then to the right by roll; radians."""
    turns = [Pose.turned(vector) for vector in ([0, 0, yaw], [0, pitch, 0], [roll, 0, 0])]
    return Pose((turns[0] @ turns[1] @ turns[2]).rotation, np.asarray(place, np.float64))


class Measured(NamedTuple):
    """What odometry says.

    Args:
        measured_s, stamp_s: when, and when by its stamp.
        pose: of the body in the fixed frame.
        velocity_m_s, rate_rad_s: float64 [3], in the body's frame, until the next report.
    """

    measured_s: float
    stamp_s: float
    pose: Pose
    velocity_m_s: np.ndarray
    rate_rad_s: np.ndarray


def measured(path: Path, rate_hz: float = 100.0, noise: float = 0.0, jitter_s: float = 0.0, seed: int = 0,
             start_s: float = 0.0) -> Iterator[Measured]:
    """The poses of a path as odometry gives them, without end.

    Args:
        rate_hz: poses a second.
        noise: of the velocity: each component is off by this share of the speed (standard deviation), and each of the
            turn by this share of its rate; alike over DRIFTS_S, so that the pose drifts. 0: exact poses.
        jitter_s: stamps are off by up to this, evenly, either way; they still rise: a pose whose stamp would not is
            left out, as a driver's would be.
        start_s: time of the first pose, which is exact.
    """
    require(0 < rate_hz < np.inf, "rate_hz", rate_hz, "a rate above 0 Hz")
    random, keeps = np.random.default_rng(seed), np.exp(-1 / (rate_hz * DRIFTS_S))
    errors, pose, newest_s = random.normal(size=6), path(start_s), -np.inf
    for t_s, next_s in pairwise(start_s + k / rate_hz for k in count()):
        exact = path(t_s).inverse() @ path(next_s)
        turn, step = exact.rotation_vector, exact.translation
        turn = turn + noise * np.linalg.norm(turn) * errors[:3]
        step = step + noise * np.linalg.norm(step) * errors[3:]
        stamp_s = t_s + random.uniform(-jitter_s, jitter_s)
        if stamp_s > newest_s:
            newest_s = stamp_s
            yield Measured(t_s, stamp_s, pose, step * rate_hz, turn * rate_hz)
        pose = pose @ Pose(Pose.turned(turn).rotation, step) if noise else path(next_s)
        errors = keeps * errors + np.sqrt(1 - keeps**2) * random.normal(size=6)


def trajectory(path: Path, first_s: float, last_s: float, **as_measured) -> Trajectory:
    """What `measured` gives from before first_s to after last_s, as the sketcher follows it; stamps are ns from 0 s."""
    known, margin_s = Trajectory(SMOOTH_NS), 0.1        # longer than a period and any likely jitter
    for report in measured(path, start_s=first_s - margin_s, **as_measured):
        known.add(round(report.stamp_s * 1e9), report.pose)
        if report.stamp_s > last_s + margin_s:
            return known
