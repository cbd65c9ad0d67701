"""The motion of a sensor from its own photons, `motion: estimate`: in the place of what a robot reports."""

from collections.abc import Callable

import numpy as np

from srt3d_ros.core.motion import Pose, Trajectory
from srt3d_ros.core.motion_estimate import MotionEstimator, Surfaces
from srt3d_ros.core.moving_sketcher import MovingFrame, MovingSketcher
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.nodes.base import PipelineNode
from srt3d_ros.nodes.depth_input import DepthInput


class EstimatedMotion:
    """Finds each frame's motion by the depth image of the frame before, or of an earlier one if that is late.

    The same methods as `MotionInput`, in the worker's thread.

    Args:
        moved: called in the worker's thread when a depth image has come that is waited for.
        wanted: whether one is.
    """

    def __init__(self, node: PipelineNode, moved: Callable[[], None], wanted: Callable[[], bool]):
        self._node, self._sketcher, self._last_ns = node, None, None
        self._depth = DepthInput(node, lambda: node.worker.call(moved) if wanted() else None)

    def of(self, sensor: SensorModel, frame_id: str = "") -> None:
        """Nothing depends on where the sensor is on a robot."""

    def update(self) -> None:
        """Nothing waits to be read."""

    def trajectory(self, frame: MovingFrame, sketcher: MovingSketcher, late: bool) -> tuple[Trajectory | None, str]:
        """The trajectory over a frame; None, and why, if there is none or, unless it is `late`, one may still come."""
        if sketcher is not self._sketcher:
            self._sketcher = sketcher
            self._sensor = sketcher.sketch_sensor
            self._estimator = MotionEstimator(self._sensor, sketcher.frequencies)
        stamp_ns = self._depth.stamp_ns(frame.to_ns)
        if stamp_ns is None or stamp_ns >= frame.to_ns:
            return self._none(frame, f"no image on {self._depth.topic} shows where surfaces were just before")
        if not late and self._last_ns is not None and stamp_ns < self._last_ns:
            return None, ""
        ranges = self._depth.ranges(self._sensor, Pose())
        if ranges is None:
            return self._none(frame, "the image on depth cannot be used")
        found = self._estimator.follow(Surfaces.of_ranges(stamp_ns, ranges, self._sensor), frame)
        if found is None:
            return self._none(frame, "its photons do not fit the last cloud under any motion")
        turn, speed = self._estimator.twist[:3], self._estimator.twist[3:]
        self._node.diagnostics.show(motion_m_s=f"{np.linalg.norm(speed):.2f}",
                                    motion_deg_s=f"{np.degrees(np.linalg.norm(turn)):.1f}")
        self._last_ns = frame.to_ns
        return found, ""

    def ranges(self, to_ns: int, trajectory: Trajectory) -> np.ndarray | None:
        """The ranges of the last cloud, moved to an instant of a trajectory."""
        return self._depth.ranges_at(to_ns, self._sensor, trajectory)

    def _none(self, frame: MovingFrame, why: str) -> tuple[None, str]:
        self._last_ns = frame.to_ns
        self._estimator.forget()
        self._node.diagnostics.show(motion_m_s="unknown", motion_deg_s="unknown")
        return None, why
