"""The motion of a sensor as its robot reports it: `odom` or `imu`, the sensor's place on the robot, and `depth`."""

from collections import deque
from collections.abc import Callable

import numpy as np
from rclpy.qos import QoSProfile, ReliabilityPolicy

from srt3d_ros.core.frame_tree import FrameTree
from srt3d_ros.core.motion import Pose, Trajectory
from srt3d_ros.core.motion_track import MotionTrack
from srt3d_ros.core.moving_sketcher import MovingFrame, MovingSketcher
from srt3d_ros.core.projection import Pinhole
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.messages import odometry
from srt3d_ros.nodes.base import LOG_EVERY_S, PipelineNode
from srt3d_ros.nodes.depth_input import DepthInput, tell

READERS = {"odom": odometry.decode_odometry, "imu": odometry.decode_imu}
ESTIMATE = "estimate"
MOTIONS = ("off", *READERS, ESTIMATE)
INBOX = 10_000              # reports that may wait for a worker that waits itself: 10 s of a fast IMU
MANY = 100                  # reports that the worker is told of in any case; telling it of each costs more than reading
ARRIVING = 256              # reports that may wait in the middleware for the executor
NAMELESS_BODY, NAMELESS_SENSOR = "a body without a name", "a sensor without a name"    # where a frame_id is empty


def parse_extrinsics(text: str) -> Pose | None:
    """The pose that a parameter `extrinsics` says; None if it is empty. InvalidInput if it is none."""
    if not text.strip():
        return None
    numbers = text.replace(",", " ").split()
    try:
        x, y, z, *quaternion = map(float, numbers)
        require(len(quaternion) == 4, "extrinsics", text, "7 numbers")
        return Pose.from_quaternion(quaternion, (x, y, z))
    except ValueError as problem:       # also InvalidInput
        raise InvalidInput("extrinsics", text, "x y z in metres and a quaternion qx qy qz qw of length 1, or nothing"
                           ) from problem


class MotionInput:
    """Subscribes to the reports while the node is active, and follows them in the worker's thread.

    Args:
        node: with the parameters `motion` and `extrinsics`.
        moved: called in the worker's thread when reports have come that are waited for, or many.
        wanted: whether reports are waited for.
    """

    def __init__(self, node: PipelineNode, moved: Callable[[], None], wanted: Callable[[], bool]):
        self._node, self._moved, self._wanted = node, moved, wanted
        self.kind = node.parameters["motion"]
        self._given = parse_extrinsics(node.parameters["extrinsics"])
        self._inbox: deque[tuple[bytes, int]] = deque(maxlen=INBOX)
        self._woken = False             # whether the worker has been told of what is in the inbox
        self._sensor: SensorModel | None = None
        self._sensor_frame = self._body = ""
        self._tree = FrameTree()
        self._has_tf = False
        self._extrinsics: Pose | None = None
        self._track, self._before = MotionTrack(), Trajectory()     # and the trajectory before it began again
        # Best effort: of those that publish reports, many are; one that is lost is missed less than one that waits.
        qos = QoSProfile(depth=ARRIVING, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._topic = node.make_subscription(self.kind, self._received, ARRIVING, qos, raw=True).topic_name
        if self._given is None:
            try:
                self._node.follow("/tf_static", self._on_transforms)
                self._has_tf = True
            except ModuleNotFoundError:     # tf2_msgs
                pass
        # where a motion may have parallax
        self._depth = DepthInput(node) if self.kind == "odom" else None

    def of(self, sensor: SensorModel, frame_id: str = "") -> None:
        """The sensor whose photons come, and their tf frame; before the first, that of the description."""
        self._sensor = sensor
        known = "" if self._sensor_frame == NAMELESS_SENSOR else self._sensor_frame
        frame_id = frame_id or known or sensor.frame_id or NAMELESS_SENSOR
        if frame_id != self._sensor_frame:
            self._sensor_frame = frame_id
            self._place()

    def trajectory(self, frame: MovingFrame, sketcher: MovingSketcher, late: bool) -> tuple[Trajectory | None, str]:
        """The trajectory over a frame; None, and why, if there is none or, unless it is `late`, one may still come."""
        span = min(frame.first_ns, frame.to_ns), max(frame.last_ns, frame.to_ns)
        for known in (self._track.trajectory, self._before):
            if known.covers(*span):
                return known, ""
        cause, may_come = self._missing(span[1])
        return None, "" if may_come and not late else cause

    def update(self) -> None:
        """Follow the reports that have come."""
        self._woken = False
        while self._inbox:
            raw, came_ns = self._inbox.popleft()
            try:
                self._follow(raw, came_ns)
            except InvalidInput as problem:
                tell(self._node, "motion_refused", f"{self._topic}: {problem}")

    def _missing(self, last_ns: int) -> tuple[str, bool]:
        """Why no trajectory covers a time that ends then, and whether one still may."""
        newest_ns = self._track.trajectory.newest_ns
        if newest_ns is not None and newest_ns >= last_ns:
            return f"what came on {self._topic} begins later, or anew within it", False
        if newest_ns is not None:
            return (f"the newest on {self._topic} is {(last_ns - newest_ns) / 1e6:.0f} ms older than its end "
                    f"(motion_timeout_s: {self._node.parameters['motion_timeout_s']:g})"), True
        if self._body and self._extrinsics is None:
            return f"/tf_static does not connect {self._sensor_frame} to {self._body}", True
        return f"nothing has come on {self._topic}", True

    def ranges(self, to_ns: int, trajectory: Trajectory) -> np.ndarray | None:
        """The ranges of the last cloud, moved to an instant of a trajectory; None if none came lately."""
        return self._depth.ranges_at(to_ns, self._sensor, trajectory) if self._depth else None

    def _received(self, raw: bytes) -> None:
        self._inbox.append((raw, self._node.now_ns()))
        if not self._woken and (len(self._inbox) >= MANY or self._wanted()):
            self._woken = True
            self._node.worker.call(self._moved)

    def _follow(self, raw: bytes, came_ns: int) -> None:
        report = READERS[self.kind](raw)
        body = report.frame_id or NAMELESS_BODY
        if body != self._body:
            self._body = body
            self._place()
        if self._extrinsics is None:
            return
        before = self._track.trajectory
        if why := self._track.add(report):
            self._before = before
            tell(self._node, "motion_restarts", f"{self._topic}: {why}; the trajectory begins again")
        self._node.diagnostics.show(motion_latency_ms=f"{(came_ns - report.stamp_ns) / 1e6:.0f}")

    def _on_transforms(self, message) -> None:
        for one in message.transforms:
            at, turn = one.transform.translation, one.transform.rotation
            try:
                pose = Pose.from_quaternion((turn.x, turn.y, turn.z, turn.w), (at.x, at.y, at.z))
                self._tree.add(one.header.frame_id, one.child_frame_id, pose)
            except InvalidInput as problem:
                tell(self._node, "motion_refused", f"/tf_static, {one.child_frame_id}: {problem}")
        self._place()

    def _place(self) -> None:
        """Find the sensor's place on the body, and begin another trajectory if it is a new one, or none any more."""
        if not (self._body and self._sensor_frame):
            return
        pose, before = self._given, self._extrinsics
        if pose is None:
            pose = self._tree.pose(self._sensor_frame, self._body) if self._has_tf else Pose()
        if pose is before or None not in (pose, before) and pose.same_as(before):
            return
        self._extrinsics, self._track, self._before = pose, MotionTrack(pose), Trajectory()
        log, at = self._node.get_logger(), "" if pose is None else f"at {np.round(pose.translation, 3).tolist()} m in"
        if before is not None:          # only /tf_static says another place than before, or none
            says = f"now has {self._sensor_frame} {at}" if at else f"does not connect {self._sensor_frame} to"
            tell(self._node, "motion_restarts", f"/tf_static {says} {self._body}; the trajectory begins again")
        elif self._given is None and not self._has_tf and self._body != self._sensor_frame:
            axes = "x right, y down, z forward" if isinstance(self._sensor.projection, Pinhole) else "x forward, z up"
            log.warning(f"extrinsics is empty and tf2_msgs is not installed: {self._sensor_frame} ({axes}) is taken to "
                        f"be where {self._body} is, and turned alike")
        else:
            log.info(f"{self._sensor_frame} is {at} {self._body}", throttle_duration_sec=LOG_EVERY_S)
