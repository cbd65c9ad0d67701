"""The depth image of the last cloud, `depth`: the ranges that a moving sensor's photons come from."""

from collections import deque
from collections.abc import Callable

import numpy as np
from rclpy.qos import QoSProfile, ReliabilityPolicy

from srt3d_ros.core.motion import Pose, Trajectory
from srt3d_ros.core.range_guide import moved_ranges
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import images
from srt3d_ros.nodes.base import LOG_EVERY_S, PipelineNode

MAX_AGE_NS = 10**9          # of a depth image: an older one shows another scene


class DepthInput:
    """Subscribes to `depth` while the node is active, best effort: a newer image comes soon.

    Args:
        came: called in the executor's thread when one has come, if anything is to be done then.
    """

    def __init__(self, node: PipelineNode, came: Callable[[], None] | None = None):
        self._node, self._came = node, came
        self._inbox: deque[bytes] = deque(maxlen=1)             # taken in another thread than it is filled in
        self._image: tuple[int, np.ndarray] | None = None       # of the newest: stamp and depths
        qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.topic = node.make_subscription("depth", self._receive, 1, qos, raw=True).topic_name

    def stamp_ns(self, to_ns: int) -> int | None:
        """The stamp of the newest image; None if none is younger than MAX_AGE_NS at an instant."""
        try:
            if self._inbox:
                header, image = images.decode_cdr(self._inbox.pop())
                self._image = header.stamp_ns, image
        except InvalidInput as problem:
            tell(self._node, "motion_refused", f"depth: {problem}")
        if self._image is None or abs(to_ns - self._image[0]) > MAX_AGE_NS:
            return None
        return self._image[0]

    def ranges(self, sensor: SensorModel, motion: Pose) -> np.ndarray | None:
        """Ranges of the newest image after a motion since, as by `moved_ranges`; None if the image is not one."""
        try:
            return moved_ranges(self._image[1], sensor, motion)
        except InvalidInput as problem:
            self._image = None
            tell(self._node, "motion_refused", f"depth: {problem}")
            return None

    def ranges_at(self, to_ns: int, sensor: SensorModel, trajectory: Trajectory) -> np.ndarray | None:
        """The same at an instant of a trajectory; None if that does not reach back to an image young enough."""
        stamp_ns = self.stamp_ns(to_ns)
        if stamp_ns is None or not trajectory.covers(stamp_ns, stamp_ns):
            return None
        return self.ranges(sensor, trajectory.motion(stamp_ns, to_ns))

    def _receive(self, raw: bytes) -> None:
        self._inbox.append(raw)
        if self._came is not None:
            self._came()


def tell(node: PipelineNode, counted: str, problem: str) -> None:
    """Say in /diagnostics and the log what is wrong with what came of the motion, and count it."""
    node.diagnostics.count(**{counted: 1})
    node.diagnostics.error(problem, counted=False)
    node.get_logger().warning(problem, throttle_duration_sec=LOG_EVERY_S)
