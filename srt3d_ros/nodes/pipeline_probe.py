"""Watch a running pipeline from outside, as any ROS 2 node could."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import PointCloud2

from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import cdr
from srt3d_ros.nodes import transport

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

    `kept` has the bytes of every `keep_every`-th cloud.
    """

    def __init__(self, keep_every: int):
        self._keep_every = keep_every
        self.arrivals: list[Arrival] = []
        self.kept: list[bytes] = []
        self.statuses: dict[str, dict[str, str]] = {}

    def __enter__(self) -> "PipelineProbe":
        transport.prepare_process()
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.node = Node("monitor")
        depth = QoSProfile(depth=CLOUDS_DEPTH)
        self.node.create_subscription(PointCloud2, "points", self._on_cloud, depth, raw=True)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, QoSProfile(depth=100))
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        return self

    def __exit__(self, *exc) -> None:
        self.node.destroy_node()
        rclpy.try_shutdown()

    def spin_until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Receive until the condition holds or the time is over; whether it holds."""
        deadline = time.monotonic() + timeout_s
        while not (met := condition()) and (left_s := deadline - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=min(left_s, 0.1))
        return bool(met)

    def value(self, node: str, key: str) -> str:
        """A value of a node's latest diagnostics; empty if there is none."""
        return self.statuses.get(node, {}).get(key, "")

    def total(self, node: str, key: str) -> int:
        """A count of a node's latest diagnostics; 0 if there is none."""
        return int(self.value(node, key) or 0)

    def latencies_ms(self) -> np.ndarray:
        """Latency of each cloud, in their order."""
        return np.array([arrival.latency_ms for arrival in self.arrivals])

    def clouds_per_second(self) -> float:
        """Mean rate from the first cloud to the last; 0 if there are not two."""
        if len(self.arrivals) < 2:
            return 0.0
        return (len(self.arrivals) - 1) * 1e9 / (self.arrivals[-1].received_ns - self.arrivals[0].received_ns)

    def _on_cloud(self, raw: bytes) -> None:
        received_ns = time.time_ns()
        try:
            cloud = cdr.read_cloud(raw)
        except InvalidInput:        # from another publisher; the nodes survive it, too
            return
        if len(self.arrivals) % self._keep_every == 0:
            self.kept.append(raw)
        self.arrivals.append(Arrival(cloud.header.stamp_ns, received_ns, cloud.height * cloud.width))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.statuses[status.name] = {pair.key: pair.value for pair in status.values}
