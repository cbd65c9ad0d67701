"""SensorMotion: the trajectory of a sensor by what its robot reports. What no robot does begins another one."""

from dataclasses import dataclass, field

import numpy as np

from srt3d_ros.core.motion.trajectory import Pose, Trajectory
from srt3d_ros.errors import require

GAP_NS = 500_000_000        # between reports: over it, an even motion is off by 3 cm at 1 m/s² (a t² / 8)
MAX_RAD_S = 35.0            # 2000 degrees a second, which common gyroscopes measure
MAX_M_S = 50.0              # where no twist says how fast the robot is
JITTER_S = 0.05             # of stamps: what the robot's own speed explains beside the time between them
SLACK_M, SLACK_RAD = 0.1, 0.1   # noise of poses. A smaller jump smears a frame less than a walk does without deskewing


@dataclass(frozen=True, eq=False)
class MotionReport:
    """Where a body was, or how fast it turned.

    Args:
        stamp_ns: when.
        pose: from the body's frame to a fixed one; None of an IMU.
        speed_m_s: 0 where it is not known.
        rate_rad_s: float64 [3], of the turn, in the body's frame.
    """

    stamp_ns: int
    pose: Pose | None = None
    speed_m_s: float = 0.0
    rate_rad_s: np.ndarray = field(default_factory=lambda: np.zeros(3))


class SensorMotion:
    """The trajectory of a sensor that is fixed to the body that is reported on.

    It begins again, so that no frame is moved over what is not known or not true, where
    - nothing came for GAP_NS, or stamps fell back by more: lost odometry, a bag or a clock that began again;
    - the body moved or turned by more than its twist explains (a correction by a SLAM, a kidnapped robot), or, where
      no speed or no rate is ever given, faster than MAX_M_S or MAX_RAD_S.

    Args:
        extrinsics: the pose of the sensor in the body's frame.
    """

    def __init__(self, extrinsics: Pose | None = None):
        self._extrinsics = extrinsics or Pose()
        self.trajectory, self._former = Trajectory(), Trajectory()
        self._last: MotionReport | None = None
        self._has_speed = self._has_rate = False        # a robot at rest reports 0, as do those that never fill it in

    def add(self, report: MotionReport) -> str:
        """Follow a report; why the trajectory begins again with it, or nothing. InvalidInput if it is out of order."""
        self._has_speed |= report.speed_m_s > 0
        self._has_rate |= bool(report.rate_rad_s.any())
        last, why = self._last, ""
        if last is not None:
            elapsed_ns = report.stamp_ns - last.stamp_ns
            require(elapsed_ns > 0 or elapsed_ns < -GAP_NS, "stamp", report.stamp_ns,
                    f"later than the last, {last.stamp_ns} ns")
            why = self._break(last, report, elapsed_ns / 1e9)
        if why:
            self._former, self.trajectory = self.trajectory, Trajectory()
        self._last = report
        if report.pose is None:
            rate_rad_s = report.rate_rad_s if last is None else (last.rate_rad_s + report.rate_rad_s) / 2
            self.trajectory.add_turn(report.stamp_ns, self._extrinsics.rotation.T @ rate_rad_s)
        else:
            self.trajectory.add(report.stamp_ns, report.pose @ self._extrinsics)
        return why

    def over(self, first_ns: int, last_ns: int, late: bool) -> tuple[Trajectory | None, str]:
        """The trajectory over a time; None, and why, if there is none or, unless it is `late`, one may still come."""
        for known in (self.trajectory, self._former):
            if known.covers(first_ns, last_ns):
                return known, ""
        newest_ns = self.trajectory.newest_ns
        if newest_ns is not None and newest_ns >= last_ns:
            return None, "the reports of motion begin later, or anew within it"
        if not late:
            return None, ""
        if newest_ns is None:
            return None, "no motion was reported"
        return None, f"the newest report of motion is {(last_ns - newest_ns) / 1e6:.0f} ms older than its end"

    def _break(self, last: MotionReport, report: MotionReport, elapsed_s: float) -> str:
        """Why the body cannot have moved evenly from the last report to this one; empty if it can."""
        if elapsed_s < 0:
            return f"stamps fell back by {-elapsed_s:.3f} s"
        if elapsed_s * 1e9 > GAP_NS:
            return f"none came for {elapsed_s:.3f} s of stamps"
        if last.pose is None or report.pose is None:
            return ""
        moved = last.pose.inverse() @ report.pose
        distance_m, turn_rad = (float(np.linalg.norm(vector)) for vector in (moved.translation, moved.rotation_vector))
        most_m, most_rad = MAX_M_S * elapsed_s, MAX_RAD_S * elapsed_s
        if self._has_speed:
            most_m = max(last.speed_m_s, report.speed_m_s) * (elapsed_s + JITTER_S)
        if self._has_rate:
            most_rad = max(map(np.linalg.norm, (last.rate_rad_s, report.rate_rad_s))) * (elapsed_s + JITTER_S)
        if distance_m <= most_m + SLACK_M and turn_rad <= most_rad + SLACK_RAD:
            return ""
        return f"it jumped by {distance_m:.2f} m and {np.degrees(turn_rad):.0f}° in {elapsed_s:.3f} s"
