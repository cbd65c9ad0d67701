"""MotionInput: the sensor's motion, from `odom` or `imu`, for any node."""

from collections import deque
from collections.abc import Callable

from srt3d_ros.core.motion.track import MotionReport, SensorMotion
from srt3d_ros.core.motion.trajectory import Pose, Trajectory
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import odometry
from srt3d_ros.nodes.common import topics
from srt3d_ros.nodes.common.diagnostics import LOG_EVERY_S
from srt3d_ros.nodes.common.managed_node import QUEUE_DEPTH, ManagedNode
from srt3d_ros.nodes.common.parameters import Parameter

SOURCES = {"odom": (topics.ODOM, odometry.decode_odometry), "imu": (topics.IMU, odometry.decode_imu)}
MOTION = "motion"           # cause of a degraded state
INBOX = 10_000              # reports queued for a busy worker: 10 s of a fast IMU


def motion_parameters(about: str) -> tuple[Parameter, Parameter]:
    """`motion` and `extrinsics`; `about` says what a node does with the motion."""
    return (
        Parameter("motion", "off", f"Source of the sensor's motion. {about}", choices=("off", *SOURCES)),
        Parameter("extrinsics", "", "Pose of the sensor in an Odometry's child_frame_id or an Imu's frame, with "
                  "motion. If empty, the sensor is assumed to coincide with that frame.",
                  form="x y z qx qy qz qw in metres, or nothing"),
    )


class MotionInput:
    """Queues reports in the executor's thread until the worker reads all of them, which is cheaper than one by one.

    Args:
        on_report: called in the executor's thread after each report.
        kind: "odom" or "imu".

    Attributes:
        topic: the resolved name.
        track: of the sensor, by `over`.
    """

    def __init__(self, node: ManagedNode, on_report: Callable[[], None], kind: str = topics.ODOM.name):
        self._node, self._on_report = node, on_report
        topic, self._read_report = SOURCES[kind]
        self.topic = node.resolve_topic_name(topic.name)
        self.track, self._mount = SensorMotion(), ""
        self._reports = deque[tuple[bytes, int]](maxlen=INBOX)
        node.endpoints.subscribe(topic, self._queue, QUEUE_DEPTH)
        node.diagnostics.count(motion_refused=0, motion_restarts=0)

    def read_into(self, add: Callable[[MotionReport], str]) -> None:
        """Pass the queued reports to `add` of a SensorMotion; count and log restarts, and reports that it refuses."""
        while self._reports:
            raw, received_ns = self._reports.popleft()
            try:
                report = self._read_report(raw)
                if cause := add(report):
                    self._report_problem("motion_restarts", f"{cause}; a new trajectory begins")
                self._node.diagnostics.show(motion_latency_ms=f"{(received_ns - report.stamp_ns) / 1e6:.0f}")
            except InvalidInput as problem:
                self._report_problem("motion_refused", str(problem))

    def over(self, mount: str, first_ns: int, last_ns: int, late: bool) -> tuple[Trajectory | None, str]:
        """`SensorMotion.over`, with the reports so far, of a sensor at the pose `mount` on the body."""
        if mount != self._mount:
            self._mount, self.track = mount, SensorMotion(Pose.from_text(mount))
        self.read_into(self.track.add)
        return self.track.over(first_ns, last_ns, late)

    def judge(self, problem: str, solved: str) -> None:
        """Warn in /diagnostics while motion has a `problem`; log when that begins, and `solved` when it ends."""
        problem = problem and f"{problem} ({self.topic})"
        if self._node.diagnostics.degrade(MOTION, problem):
            self._node.get_logger().warning(problem or solved)

    def _queue(self, raw: bytes, _) -> None:
        self._reports.append((raw, self._node.now_ns()))
        self._on_report()

    def _report_problem(self, counted: str, problem: str) -> None:
        problem = f"{self.topic}: {problem}"
        self._node.diagnostics.count(**{counted: 1})
        self._node.diagnostics.error(problem, counted=False)
        self._node.get_logger().warning(problem, throttle_duration_sec=LOG_EVERY_S)
