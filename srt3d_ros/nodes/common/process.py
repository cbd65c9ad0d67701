"""The process of a node."""

import logging
import os
import signal
import sys
import threading

import rclpy.utilities
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.signals import SignalHandlerOptions

from srt3d_ros.errors import BAD_INPUT, InvalidInput, require
from srt3d_ros.nodes.common import rclpy_patches
from srt3d_ros.nodes.common.managed_node import ManagedNode
from srt3d_ros.processes import transport

WAKE_S = 0.1            # longest time until a signal is noticed
RETRY_S = 0.01          # pause after a callback that failed: it may fail every time
LIBRARY = logging.getLogger("srt3d_ros")


class LogForwarding(logging.Handler):
    """Forwards the library's log to a node's logger, and so to /rosout."""

    def __init__(self, logger: RcutilsLogger):
        super().__init__(logging.INFO)
        self._logger = logger
        LIBRARY.setLevel(logging.INFO)
        LIBRARY.addHandler(self)        # never removed: the process has a single node

    def emit(self, record: logging.LogRecord) -> None:
        """Log a record. rclpy requires each severity to come from its own source line."""
        if record.levelno >= logging.WARNING:
            self._logger.warning(record.getMessage())
        else:
            self._logger.info(record.getMessage())


def run(node_class: type[ManagedNode]) -> int:
    """Run a node in this process until it is finished or a signal arrives.

    While the node starts, signals act as the caller has set them. From then on, SIGINT and SIGTERM let it finish its
    frames and its recording; rclpy's own handlers would invalidate the context meanwhile. If a callback raises, the
    error is counted and logged, and the node goes on.

    Returns:
        The node's exit code: 0 unless it failed, also after SIGINT and SIGTERM; 2, with one line on stderr, if a
        parameter, an argument or an input file cannot be used.
    """
    os.nice(node_class.niceness)        # before there are other threads, which inherit it
    transport.prepare_process()
    try:
        node = _make_node(node_class)
        try:
            LogForwarding(node.get_logger())
            _start_and_spin(node)
        finally:
            node.close()
        return node.exit_code
    except InvalidInput as error:
        print(f"srt3d: error: {error}", file=sys.stderr)
        return BAD_INPUT
    finally:
        rclpy.utilities.try_shutdown()


def _make_node(node_class: type[ManagedNode]) -> ManagedNode:
    """Start ROS 2 with `sys.argv` and create the node; InvalidInput if it rejects command line or environment."""
    try:
        unused = " ".join(rclpy.utilities.remove_ros_args(sys.argv)[1:])
        require(not unused, "command line", problem=f"{unused}: put --ros-args before arguments for ROS 2, as in "
                "--ros-args -p name:=value.")
        rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
        return node_class()
    except RuntimeError as error:       # of rcl
        raise InvalidInput("command line", problem=f"ROS 2 cannot start the node: {error}") from None


def _start_and_spin(node: ManagedNode) -> None:
    """Configure and activate the node if `autostart` is true; from then on, signals stop it."""
    outcome, stop = "ready", threading.Event()
    if node.parameters["autostart"]:
        node.start()
    else:
        outcome = f"unconfigured, as autostart is false: ros2 lifecycle set {node.get_fully_qualified_name()} configure"
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    node.get_logger().info(outcome)
    node.diagnostics.report()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not (stop.is_set() or node.finished.is_set()):
        try:
            rclpy_patches.spin_once(executor, WAKE_S)
        except Exception as problem:
            if not rclpy.utilities.ok():
                raise
            node.failed(problem)
            stop.wait(RETRY_S)
