"""The depth image of the last cloud, `depth`: the ranges that a moving sensor's photons come from."""

from collections.abc import Callable

import numpy as np
from rclpy.qos import QoSProfile, ReliabilityPolicy

from srt3d_ros.core.motion import Pose
from srt3d_ros.core.range_guide import moved_ranges
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import images
from srt3d_ros.nodes.base import PipelineNode

MAX_AGE_NS = 10**9          # of a depth image: an older one shows another scene


class DepthInput:
    """Subscribes to `depth` while the node is active, best effort: a newer image comes soon.

    Args:
        refuse: called in the worker's thread with what is wrong with an image.
        came: called in the executor's thread when one has come, if anything is to be done then.
    """

    def __init__(self, node: PipelineNode, refuse: Callable[[str], None], came: Callable[[], None] | None = None):
        self._refuse, self._came = refuse, came
        self._raw: bytes | None = None
        self._image: tuple[int, np.ndarray] | None = None       # of the newest: stamp and depths
        qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.topic = node.make_subscription("depth", self._receive, 1, qos, raw=True).topic_name

    def stamp_ns(self, to_ns: int) -> int | None:
        """The stamp of the newest image; None if none is younger than MAX_AGE_NS at an instant."""
        raw, self._raw = self._raw, None
        try:
            if raw is not None:
                header, image = images.decode_cdr(raw)
                self._image = header.stamp_ns, image
        except InvalidInput as problem:
            self._refuse(f"depth: {problem}")
        if self._image is None or abs(to_ns - self._image[0]) > MAX_AGE_NS:
            return None
        return self._image[0]

    def ranges(self, sensor: SensorModel, motion: Pose) -> np.ndarray | None:
        """Ranges of the newest image after a motion since, as by `moved_ranges`; None if the image is not one."""
        try:
            return moved_ranges(self._image[1], sensor, motion)
        except InvalidInput as problem:
            self._image = None
            self._refuse(f"depth: {problem}")
            return None

    def _receive(self, raw: bytes) -> None:
        self._raw = raw
        if self._came is not None:
            self._came()
