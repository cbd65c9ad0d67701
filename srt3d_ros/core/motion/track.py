"""SensorMotion: the trajectory of a sensor from its robot's reports. An impossible jump starts a new trajectory."""

from dataclasses import dataclass, field

import numpy as np

from srt3d_ros.core.motion.trajectory import Pose, Trajectory
from srt3d_ros.errors import require

GAP_NS = 500_000_000        # between reports, at most: uniform motion over it errs by 3 cm at 1 m/s² (a t² / 8)
MAX_RAD_S = 35.0            # 2000 degrees a second, the range of common gyroscopes
MAX_M_S = 50.0              # if no twist gives the robot's speed
JITTER_S = 0.05             # of stamps: added to the time that the robot had to move
SLACK_M, SLACK_RAD = 0.1, 0.1   # noise of poses: a smaller jump blurs a frame less than uncorrected walking


@dataclass(frozen=True, eq=False)
class MotionReport:
    """A body's pose, or how fast it turned.

    Args:
        stamp_ns: when.
        pose: from the body's frame to a fixed one; None from an IMU.
        speed_m_s: 0 if not known.
        rate_rad_s: float64 [3], angular velocity in the body's frame.
        frame_id: of the fixed frame.
    """

    stamp_ns: int
    pose: Pose | None = None
    speed_m_s: float = 0.0
    rate_rad_s: np.ndarray = field(default_factory=lambda: np.zeros(3))
    frame_id: str = ""


class SensorMotion:
    """The trajectory of a sensor that is fixed to the reported body.

    A new trajectory starts, so that no frame is moved across the break, if
    - poses are in another fixed frame;
    - no report came for GAP_NS, or stamps fell back by more: lost odometry, a bag or a clock that began again;
    - the body moved or turned by more than its twist explains (a correction by SLAM, a robot that was carried), or, if
      reports never have a speed or a rate, faster than MAX_M_S or MAX_RAD_S.

    Args:
        extrinsics: the pose of the sensor in the body's frame.
    """

    def __init__(self, extrinsics: Pose | None = None):
        self._extrinsics = extrinsics or Pose()
        self.trajectory, self._former = Trajectory(), Trajectory()
        self._last: MotionReport | None = None
        self._has_speed = self._has_rate = False        # 0 may mean "at rest" or "not filled in"

    def add(self, report: MotionReport) -> str:
        """Add a report; returns the reason to start a new trajectory, or "". InvalidInput if it is out of order."""
        self._has_speed |= report.speed_m_s > 0
        self._has_rate |= bool(report.rate_rad_s.any())
        last, reason = self._last, ""
        if last is not None:
            elapsed_ns = report.stamp_ns - last.stamp_ns
            require(elapsed_ns > 0 or elapsed_ns < -GAP_NS, "stamp", report.stamp_ns,
                    f"later than the last, {last.stamp_ns} ns")
            reason = self._break(last, report, elapsed_ns / 1e9)
        if reason:
            self._former, self.trajectory = self.trajectory, Trajectory()
        self._last = report
        if report.pose is None:
            rate_rad_s = report.rate_rad_s if last is None else (last.rate_rad_s + report.rate_rad_s) / 2
            self.trajectory.add_turn(report.stamp_ns, self._extrinsics.rotation.T @ rate_rad_s)
        else:
            self.trajectory.add(report.stamp_ns, report.pose @ self._extrinsics)
        return reason

    def over(self, first_ns: int, last_ns: int, late: bool) -> tuple[Trajectory | None, str]:
        """The trajectory from `first_ns` to `last_ns`, and "": or None, and the reason or, while reports may come, "".

        Args:
            late: whether to wait no longer for reports.
        """
        for known in (self.trajectory, self._former):
            if known.covers(first_ns, last_ns):
                return known, ""
        newest_ns = self.trajectory.newest_ns
        if newest_ns is not None and newest_ns >= last_ns:
            return None, "the reports of motion begin or jump within the frame"
        if not late:
            return None, ""
        if newest_ns is None:
            return None, "no motion was reported"
        return None, f"the newest report of motion is {(last_ns - newest_ns) / 1e6:.0f} ms older than the frame's end"

    def _break(self, last: MotionReport, report: MotionReport, elapsed_s: float) -> str:
        """Why the motion from the last report to this one is impossible; "" if it is possible."""
        if elapsed_s < 0:
            return f"stamps fell back by {-elapsed_s:.3f} s"
        if elapsed_s * 1e9 > GAP_NS:
            return f"no report for {elapsed_s:.3f} s of stamps"
        if last.frame_id != report.frame_id:
            return f"frame_id changed from {last.frame_id!r} to {report.frame_id!r}"
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
        return f"the body jumped by {distance_m:.2f} m and {np.degrees(turn_rad):.0f}° in {elapsed_s:.3f} s"
