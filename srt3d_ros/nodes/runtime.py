"""Run a node in this process: start it, spin it, and end it in order whatever ends it."""

import logging
import os
import signal
import sys
import threading
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from srt3d_ros import transport
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.nodes.base import PipelineNode
from srt3d_ros.nodes.parameters import file_warnings

WAKE_S = 0.1            # longest time until a signal is seen
SWALLOWED_S = 2.0       # a start that goes on for so long after an interrupt has swallowed it
BAD_INPUT = 2
LIBRARY = logging.getLogger("srt3d_ros")


class LogForwarding(logging.Handler):
    """Forwards what the library logs to a node's logger, and so to /rosout."""

    def __init__(self, logger):
        super().__init__(logging.INFO)
        self._logger = logger
        LIBRARY.setLevel(logging.INFO)
        LIBRARY.addHandler(self)        # for good: the process is the node's

    def emit(self, record: logging.LogRecord) -> None:
        """Log it; rclpy wants each severity to come from a source line of its own."""
        if record.levelno >= logging.WARNING:
            self._logger.warning(record.getMessage())
        else:
            self._logger.info(record.getMessage())


class _Stop:
    """True once SIGINT or SIGTERM came. While `starting`, either interrupts at once: compiling may take long."""

    def __init__(self):
        self.requested = False
        self.starting = True
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)

    def _on_signal(self, number, frame) -> None:
        self.requested = True
        if self.starting:
            # A compiler may swallow the interrupt and go on: print nothing about it, and do not wait for it.
            sys.unraisablehook = lambda _: None
            threading.Thread(target=self._leave, daemon=True).start()
            raise KeyboardInterrupt

    def _leave(self) -> None:
        time.sleep(SWALLOWED_S)
        if self.starting:
            os._exit(0)


def run(node_class: type[PipelineNode]) -> int:
    """Make the node, start it unless `autostart` is false, spin it until it is done or a signal comes, close it.

    rclpy's own signal handlers invalidate the context at once; these let the node finish its frames, its recording and
    its last diagnostics first.

    Returns:
        The node's exit code, 0 unless it failed, also after SIGINT and SIGTERM; 2 with one line on stderr if a
        parameter, an argument or an input file cannot be used.
    """
    os.nice(node_class.niceness)        # before there are other threads, which inherit it
    stop = _Stop()
    transport.prepare_process()
    node = None
    try:
        _init(sys.argv)
        node = _make(node_class)
        LogForwarding(node.get_logger())
        for line in file_warnings(sys.argv, node.get_fully_qualified_name()):
            node.get_logger().warning(line)
        _start(node)
        stop.starting = False
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while not (stop.requested or node.finished.is_set()):
            try:
                executor.spin_once(timeout_sec=WAKE_S)
            except rclpy_implementation.InvalidHandle:
                continue    # the worker destroyed a subscription whose events rclpy was about to wait for
    except KeyboardInterrupt:
        pass
    except InvalidInput as error:
        print(f"srt3d: error: {error}", file=sys.stderr)
        return BAD_INPUT
    except Exception:
        if not stop.requested:      # a compiler that is interrupted swallows the interrupt and then fails with anything
            raise
    finally:
        stop.starting = False
        if node is not None:
            node.close()
        rclpy.try_shutdown()
    return node.exit_code if node is not None else 0


def _make(node_class: type[PipelineNode]) -> PipelineNode:
    try:
        return node_class()
    except rclpy_implementation.RCLError as error:
        if os.environ.get("ROS_SECURITY_ENABLE") != "true":
            raise
        raise InvalidInput("ROS_SECURITY_ENABLE", "true", "a middleware with DDS security and a keystore that it "
                           f"accepts, see docs/deployment.md ({' '.join(str(error).split())})") from None


def _start(node: PipelineNode) -> None:
    """Configure and activate the node if `autostart` is true."""
    if node.parameters["autostart"]:
        node.start()
        node.get_logger().info("ready")
    else:
        node.get_logger().info(f"unconfigured, as autostart is false: ros2 lifecycle set "
                               f"{node.get_fully_qualified_name()} configure")
    node.diagnostics.report()


def _init(given: list[str]) -> None:
    try:
        rclpy.init(args=given, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:       # what rcl raises for arguments that it cannot parse
        if "Failed to create log" in str(error):
            variable = "ROS_HOME" if os.environ.get("ROS_HOME") and not os.environ.get("ROS_LOG_DIR") else "ROS_LOG_DIR"
            raise InvalidInput(variable, os.environ.get(variable) or os.path.expanduser("~/.ros/log"),
                               "a folder that can be written, for ROS 2's log") from None
        raise InvalidInput("command line", " ".join(given[1:]), f"ROS arguments ({error})") from None
    unused = remove_ros_args(given)[1:]     # -p, say, without --ros-args before it
    require(not unused, "command line", " ".join(given[1:]), f"nothing but --ros-args and what follows it, such as "
            f"--ros-args -p name:=value; not {' '.join(unused)}")
