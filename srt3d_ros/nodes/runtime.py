"""From process to nodes and back: start, spin, and an orderly end for every way in which it may end."""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.nodes.base import PipelineNode
from srt3d_ros.nodes.parameter_files import given_files, passed_over

WAKE_S = 0.1            # how long a signal may go unnoticed
SWALLOWED_S = 2.0       # after an interrupt of the start, from which on it is taken for swallowed
HAND_OVER_S = 0.3       # from a node that is closed to the next in the same process
BAD_INPUT = 2


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
            # A compiler may swallow the interrupt and go on: then there is no need to read of it, nor to wait for it.
            sys.unraisablehook = lambda _: None
            threading.Thread(target=self._leave, daemon=True).start()
            raise KeyboardInterrupt

    def _leave(self) -> None:
        time.sleep(SWALLOWED_S)
        if self.starting:
            os._exit(0)


def run(make_nodes: Sequence[Callable[[], PipelineNode]], args: list[str] | None = None,
        ready: Callable[[list[PipelineNode]], None] = lambda nodes: None) -> int:
    """Make the nodes, start those that start by themselves, spin until one is done or a signal comes, close them.

    rclpy's own signal handlers invalidate the context at once, in the middle of whatever runs; ours let the nodes
    finish their frames, their recordings and their last diagnostics first.

    Args:
        make_nodes: in the order in which they start, against the flow of data: who listens, before who speaks.
        args: ROS arguments; the process's own unless given.
        ready: called with the nodes once all are started.

    Returns:
        The exit code of the nodes, which is 0 unless one failed, also after SIGINT and SIGTERM; 2 with one line on
        stderr if a parameter, an argument or an input file cannot be used.
    """
    given = sys.argv if args is None else args
    stop = _Stop()
    nodes: list[PipelineNode] = []
    try:
        _init(given)
        for make_node in make_nodes:
            nodes.append(_make(make_node))
        _warn_of_files(given, nodes)
        for node in nodes:
            _start(node)
        stop.starting = False
        if not stop.requested:
            ready(nodes)
        executor = SingleThreadedExecutor()
        for node in nodes:
            executor.add_node(node)
        while not (stop.requested or any(node.finished.is_set() for node in nodes)):
            executor.spin_once(timeout_sec=WAKE_S)
        _close_in_order(nodes, executor)
    except KeyboardInterrupt:
        pass
    except InvalidInput as error:
        print(error, file=sys.stderr)
        return BAD_INPUT
    except Exception:
        if not stop.requested:      # a compiler that is interrupted swallows the interrupt and then fails with anything
            raise
    finally:
        stop.starting = False
        for node in nodes:
            node.close()
        rclpy.try_shutdown()
    return max((node.exit_code for node in nodes), default=0)


def _make(make_node: Callable[[], PipelineNode]) -> PipelineNode:
    try:
        return make_node()
    except rclpy_implementation.RCLError as error:
        if os.environ.get("ROS_SECURITY_ENABLE") != "true":
            raise
        raise InvalidInput("ROS_SECURITY_ENABLE", "true", "a middleware with DDS security and a keystore that it "
                           f"accepts, see docs/security.md ({' '.join(str(error).split())})") from None


def _warn_of_files(arguments: Sequence[str], nodes: Sequence[PipelineNode]) -> None:
    names = [node.get_fully_qualified_name() for node in nodes]
    for path in given_files(arguments):
        for line in passed_over(path, names):
            nodes[0].get_logger().warning(line)


def _start(node: PipelineNode) -> None:
    """Configure and activate, unless somebody else is to do that."""
    if node.parameters["autostart"]:
        node.start()
        node.get_logger().info("ready")
    else:
        node.get_logger().info(f"unconfigured, as autostart is false: ros2 lifecycle set "
                               f"{node.get_fully_qualified_name()} configure")
    node.diagnostics.report()


def _close_in_order(nodes: list[PipelineNode], executor: SingleThreadedExecutor) -> None:
    """Close the source first, and give each node's last messages time to reach the next."""
    while len(nodes) > 1:
        source = nodes.pop()
        executor.remove_node(source)
        source.close()
        end = time.monotonic() + HAND_OVER_S
        while (left_s := end - time.monotonic()) > 0:
            executor.spin_once(timeout_sec=left_s)


def _init(given: list[str]) -> None:
    try:
        rclpy.init(args=given, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:       # what rcl raises for arguments that it cannot parse
        raise InvalidInput("command line", " ".join(given[1:]), f"ROS arguments ({error})") from None
    unused = remove_ros_args(given)[1:]     # -p, say, without --ros-args before it
    require(not unused, "command line", " ".join(given[1:]), f"nothing but --ros-args and what follows it, such as "
            f"--ros-args -p name:=value; not {' '.join(unused)}")
