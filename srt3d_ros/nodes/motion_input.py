"""The motion of a sensor as its robot reports it, `odom` or `imu`, and the ranges of the last cloud, `depth`."""

from collections import deque
from collections.abc import Callable

import numpy as np
from rclpy.qos import QoSProfile, ReliabilityPolicy

from srt3d_ros.core.deskew import moved_ranges
from srt3d_ros.core.motion import Pose, Trajectory
from srt3d_ros.core.motion_track import MotionTrack
from srt3d_ros.core.moving_sketcher import MovingFrame
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.messages import images, odometry
from srt3d_ros.nodes.base import LOG_EVERY_S, PipelineNode

READERS = {"odom": odometry.decode_odometry, "imu": odometry.decode_imu}
MOTIONS = ("off", *READERS)
INBOX = 10_000              # reports that may wait for a worker that waits itself: 10 s of a fast IMU
MANY = 100                  # reports that the worker is told of in any case; telling it of each costs more than reading
ARRIVING = 256              # reports that may wait in the middleware for the executor
MAX_AGE_NS = 10**9          # of a depth image: an older one shows another scene


def parse_extrinsics(text: str) -> Pose:
    """The pose that a parameter `extrinsics` says, that of the body if it is empty. InvalidInput if it is none."""
    if not text.strip():
        return Pose()
    try:
        x, y, z, *quaternion = map(float, text.replace(",", " ").split())
        require(len(quaternion) == 4, "extrinsics", text, "7 numbers")
        return Pose.from_quaternion(quaternion, (x, y, z))
    except ValueError as problem:       # also InvalidInput
        raise InvalidInput("extrinsics", text, "x y z in metres and a quaternion qx qy qz qw of length 1, or nothing"
                           ) from problem


class MotionInput:
    """Subscribes while the node is active, and follows the reports in the worker's thread.

    Best effort: many publishers of reports are, and a report or an image that is lost is missed less than one that
    waits.

    Args:
        node: with the parameters `motion` and `extrinsics`.
        moved: called in the worker's thread when reports have come that are waited for, or many.
        wanted: whether reports are waited for.
    """

    def __init__(self, node: PipelineNode, moved: Callable[[], None], wanted: Callable[[], bool]):
        self._node, self._moved, self._wanted = node, moved, wanted
        kind, extrinsics = node.parameters["motion"], node.parameters["extrinsics"]
        self._read, self._inbox = READERS[kind], deque[tuple[bytes, int]](maxlen=INBOX)
        self._woken = False                         # whether the worker has been told of what is in the inbox
        self._track, self._before = MotionTrack(parse_extrinsics(extrinsics)), Trajectory()     # before it began again
        self._images = deque[bytes](maxlen=1)
        self._image: tuple[int, np.ndarray] | None = None       # of the newest: stamp and depths
        self._topic = self._subscribe(kind, self._received, ARRIVING)
        if kind == "odom":                          # else the motion has no parallax
            self._subscribe("depth", lambda raw: self._images.append(raw), 1)
        if not extrinsics.strip():
            node.get_logger().warning(f"extrinsics is empty: the sensor is taken to be where the body is that "
                                      f"{self._topic} reports on, and turned alike")

    def trajectory(self, frame: MovingFrame, late: bool) -> tuple[Trajectory | None, str]:
        """The trajectory over a frame; None, and why, if there is none or, unless it is `late`, one may still come."""
        for known in (self._track.trajectory, self._before):
            if known.covers(frame.first_ns, frame.last_ns):
                return known, ""
        newest_ns = self._track.trajectory.newest_ns
        if newest_ns is not None and newest_ns >= frame.last_ns:
            return None, f"what came on {self._topic} begins later, or anew within it"
        if not late:
            return None, ""
        if newest_ns is None:
            return None, f"nothing has come on {self._topic}"
        return None, f"the newest on {self._topic} is {(frame.last_ns - newest_ns) / 1e6:.0f} ms older than its end"

    def update(self) -> None:
        """Follow the reports that have come."""
        self._woken = False
        while self._inbox:
            raw, came_ns = self._inbox.popleft()
            try:
                report, before = self._read(raw), self._track.trajectory
                if why := self._track.add(report):
                    self._before = before
                    self._tell("motion_restarts", f"{self._topic}: {why}; the trajectory begins again")
                self._node.diagnostics.show(motion_latency_ms=f"{(came_ns - report.stamp_ns) / 1e6:.0f}")
            except InvalidInput as problem:
                self._tell("motion_refused", f"{self._topic}: {problem}")

    def ranges(self, to_ns: int, sensor: SensorModel, trajectory: Trajectory) -> np.ndarray | None:
        """The ranges of the last cloud, moved to an instant of a trajectory; None if none came lately."""
        try:
            if self._images:
                header, image = images.decode_cdr(self._images.pop())
                self._image = header.stamp_ns, image
            if self._image is None:
                return None
            stamp_ns, depth = self._image
            if abs(to_ns - stamp_ns) > MAX_AGE_NS or not trajectory.covers(stamp_ns, stamp_ns):
                return None
            return moved_ranges(depth, sensor, trajectory.motion(stamp_ns, to_ns))
        except InvalidInput as problem:
            self._image = None
            self._tell("motion_refused", f"depth: {problem}")
            return None

    def _subscribe(self, topic: str, received: Callable[[bytes], None], depth: int) -> str:
        qos = QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
        return self._node.make_subscription(topic, received, depth, qos, raw=True).topic_name

    def _received(self, raw: bytes) -> None:
        self._inbox.append((raw, self._node.now_ns()))
        if not self._woken and (len(self._inbox) >= MANY or self._wanted()):
            self._woken = True
            self._node.worker.call(self._moved)

    def _tell(self, counted: str, problem: str) -> None:
        """Say in /diagnostics and the log what is wrong with what came of the motion, and count it."""
        self._node.diagnostics.count(**{counted: 1})
        self._node.diagnostics.error(problem, counted=False)
        self._node.get_logger().warning(problem, throttle_duration_sec=LOG_EVERY_S)
