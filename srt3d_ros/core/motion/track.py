"""SensorMotion: the trajectory of a sensor from its robot's reports."""

from dataclasses import dataclass, field

import numpy as np

from srt3d_ros.core.motion.trajectory import Pose, Trajectory
from srt3d_ros.errors import require

GAP_NS = 500_000_000        # between reports, at most: uniform motion over it errs by 3 cm at 1 m/s² (a t² / 8)


@dataclass(frozen=True, eq=False)
class MotionReport:
    """A body's pose, or how fast it turned.

    Args:
        stamp_ns: when.
        pose: from the body's frame to a fixed one, without jumps; None from an IMU.
        rate_rad_s: float64 [3], angular velocity in the body's frame, of an IMU.
        frame_id: of the fixed frame.
    """

    stamp_ns: int
    pose: Pose | None = None
    rate_rad_s: np.ndarray = field(default_factory=lambda: np.zeros(3))
    frame_id: str = ""


class SensorMotion:
    """The trajectory of a sensor that is fixed to the reported body.

    A new trajectory starts, so that no frame is moved across the break, if poses are in another fixed frame, or if no
    report came for GAP_NS or stamps fell back by more: lost odometry, a bag or a clock that began again.

    Args:
        extrinsics: the pose of the sensor in the body's frame.
    """

    def __init__(self, extrinsics: Pose | None = None):
        self._extrinsics = extrinsics or Pose()
        self.trajectory, self._former = Trajectory(), Trajectory()
        self._last: MotionReport | None = None

    def add(self, report: MotionReport) -> str:
        """Add a report; returns the reason to start a new trajectory, or "". InvalidInput if it is out of order."""
        last, reason = self._last, ""
        if last is not None:
            elapsed_ns = report.stamp_ns - last.stamp_ns
            require(elapsed_ns > 0 or elapsed_ns < -GAP_NS, "stamp", report.stamp_ns,
                    f"later than the last, {last.stamp_ns} ns")
            if elapsed_ns < 0:
                reason = f"stamps fell back by {-elapsed_ns / 1e9:.3f} s"
            elif elapsed_ns > GAP_NS:
                reason = f"no report for {elapsed_ns / 1e9:.3f} s of stamps"
            elif last.frame_id != report.frame_id:
                reason = f"frame_id changed from {last.frame_id!r} to {report.frame_id!r}"
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
            return None, "the reports of motion begin within the frame"
        if not late:
            return None, ""
        if newest_ns is None:
            return None, "no motion was reported"
        return None, f"the newest report of motion is {(last_ns - newest_ns) / 1e6:.0f} ms older than the frame's end"
