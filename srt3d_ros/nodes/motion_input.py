"""MotionInput: the motion of the robot, from `odom` or `imu`, for a node's worker."""

from collections import deque
from collections.abc import Callable

from srt3d_ros.core.motion.track import MotionReport
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import odometry
from srt3d_ros.nodes.common import topics
from srt3d_ros.nodes.common.failures import LOG_EVERY_S
from srt3d_ros.nodes.common.managed_node import QUEUE_DEPTH, ManagedNode
from srt3d_ros.nodes.common.parameters import Parameter

SOURCES = {topic.name: topic for topic in topics.MOTION}
READERS = {"odom": odometry.decode_odometry, "imu": odometry.decode_imu}
MOTION_SOURCES = ("off", *READERS)
MOTION_PARAMETERS = (
    Parameter("motion", "off", "Source of the sensor's motion. Photons of a frame of several packets are moved to the "
              "sensor's pose in the middle of the frame, which becomes the stamp, before they are added. odom: "
              "nav_msgs/Odometry. imu: rotation only.", choices=MOTION_SOURCES, loose=True),
    Parameter("extrinsics", "", "Pose of the sensor in an Odometry's child_frame_id or an Imu's frame, with motion. If "
              "empty, the sensor is assumed to coincide with that frame.",
              form="x y z qx qy qz qw in metres, or nothing", loose=True),
)
INBOX = 10_000              # reports queued for a busy worker: 10 s of a fast IMU


class MotionInput:
    """Queues reports in the executor's thread until the worker reads all of them, which is cheaper than one by one.

    Args:
        kind: "odom" or "imu".
        on_report: called in the executor's thread after each report.

    Attributes:
        topic: the resolved name.
    """

    def __init__(self, node: ManagedNode, kind: str = "odom", on_report: Callable[[], None] = lambda: None):
        self._node, self._on_report = node, on_report
        self.topic, self._read_report = node.resolve_topic_name(kind), READERS[kind]
        self._reports = deque[tuple[bytes, int]](maxlen=INBOX)
        node.endpoints.subscribe(SOURCES[kind], self._queue, QUEUE_DEPTH, raw=True)
        node.diagnostics.count(motion_refused=0, motion_restarts=0)

    def read_into(self, add: Callable[[MotionReport], str]) -> None:
        """Pass the queued reports on, as to `SensorMotion.add`; count and log those that cannot be used."""
        while self._reports:
            raw, received_ns = self._reports.popleft()
            try:
                report = self._read_report(raw)
                if cause := add(report):
                    self._report_problem("motion_restarts", f"{cause}; a new trajectory begins")
                self._node.diagnostics.show(motion_latency_ms=f"{(received_ns - report.stamp_ns) / 1e6:.0f}")
            except InvalidInput as problem:
                self._report_problem("motion_refused", str(problem))

    def judge(self, warning: str, good: str) -> None:
        """Report a warning while there is one, and log when that begins and, by `good`, ends."""
        diagnostics, before = self._node.diagnostics, self._node.diagnostics.degraded
        diagnostics.degraded = warning and f"{warning} ({self.topic})"
        if bool(before) != bool(warning):
            self._node.get_logger().warning(diagnostics.degraded or good)

    def _queue(self, raw: bytes, _) -> None:
        self._reports.append((raw, self._node.now_ns()))
        self._on_report()

    def _report_problem(self, counted: str, problem: str) -> None:
        problem = f"{self.topic}: {problem}"
        self._node.diagnostics.count(**{counted: 1})
        self._node.diagnostics.error(problem, counted=False)
        self._node.get_logger().warning(problem, throttle_duration_sec=LOG_EVERY_S)
