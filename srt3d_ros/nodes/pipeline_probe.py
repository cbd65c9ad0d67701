"""Watch a running pipeline from outside, as any ROS 2 node could."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import PointCloud2

from srt3d_ros import transport
from srt3d_ros.messages import cdr

CLOUDS_DEPTH = 64       # the probe shares its machine with the pipeline: clouds wait rather than be lost


@dataclass(frozen=True)
class Arrival:
    """When a cloud arrived, and how many points it has."""

    stamp_ns: int
    received_ns: int
    points: int

    @property
    def latency_ms(self) -> float:
        """From the photons' stamp to the arrival of the cloud."""
        return (self.received_ns - self.stamp_ns) * 1e-6


class PipelineProbe:
    """Subscribes to `points` and /diagnostics; a context manager, inside which `spin_until` receives.

    Attributes:
        arrivals: of all clouds.
        kept: the bytes of every `keep_every`-th cloud.
        statuses: the latest diagnostics of each node.
    """

    def __init__(self, keep_every: int):
        self._keep_every = keep_every
        self.arrivals: list[Arrival] = []
        self.kept: list[bytes] = []
        self.statuses: dict[str, dict[str, str]] = {}

    def __enter__(self) -> "PipelineProbe":
        transport.prepare_process()
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("monitor")
        self._node.create_subscription(PointCloud2, "points", self._on_cloud, QoSProfile(depth=CLOUDS_DEPTH), raw=True)
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, QoSProfile(depth=100))
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        return self

    def __exit__(self, *exc) -> None:
        self._node.destroy_node()
        rclpy.try_shutdown()

    def spin_until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Receive until the condition holds or the time is over; whether it holds."""
        deadline = time.monotonic() + timeout_s
        while not (met := condition()) and (left_s := deadline - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=min(left_s, 0.1))
        return bool(met)

    def total(self, node: str, key: str) -> int:
        """A count of a node's latest diagnostics; 0 if there is none."""
        return int(self.statuses.get(node, {}).get(key, 0))

    def _on_cloud(self, raw: bytes) -> None:
        received_ns, cloud = time.time_ns(), cdr.read_cloud(raw)
        if len(self.arrivals) % self._keep_every == 0:
            self.kept.append(raw)
        self.arrivals.append(Arrival(cloud.header.stamp_ns, received_ns, cloud.height * cloud.width))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.statuses[status.name] = {pair.key: pair.value for pair in status.values}
