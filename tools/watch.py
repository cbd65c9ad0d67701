"""Print, as lines of JSON, the diagnostics of all nodes and each message that arrives on one topic.

    PYTHONPATH=. python tools/watch.py sketch

It subscribes as the nodes do: reliable, with a short queue of the newest messages.
"""

import contextlib
import json
import sys
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import ExternalShutdownException
from sensor_msgs.msg import PointCloud2

from srt3d_ros.messages import cdr
from srt3d_ros.nodes.common.managed_node import SUBSCRIBE_DEPTH
from srt3d_ros.processes import transport


def main() -> None:
    transport.prepare_process()
    rclpy.init(args=[])
    node = rclpy.create_node("watch")
    node.create_subscription(DiagnosticArray, "/diagnostics", _on_diagnostics, 100)
    node.create_subscription(PointCloud2, sys.argv[1], _on_message, SUBSCRIBE_DEPTH, raw=True)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


def _on_message(raw: bytes) -> None:
    _print(received_ns=time.time_ns(), stamp_ns=cdr.CloudMessage.read(raw).header.stamp_ns)


def _on_diagnostics(message: DiagnosticArray) -> None:
    for status in message.status:
        _print(node=status.name, values={pair.key: pair.value for pair in status.values})


def _print(**facts) -> None:
    print(json.dumps(facts), flush=True)


if __name__ == "__main__":
    main()
