"""From process to node and back: start, spin, and an orderly end for every way in which it may end."""

import signal
import sys
from collections.abc import Callable

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from srt3d_ros.errors import InvalidInput
from srt3d_ros.nodes.base import PipelineNode

WAKE_S = 0.1            # how long a signal may go unnoticed
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
            raise KeyboardInterrupt


def run(make_node: Callable[[], PipelineNode], args: list[str] | None = None) -> int:
    """Make and configure the node, spin it until it is done or a signal comes, close it; returns the exit code.

    rclpy's own signal handlers invalidate the context at once, in the middle of whatever runs; ours let the node
    finish its frame, its recording and its last diagnostics first.

    Returns:
        The node's exit code, which is 0 unless it failed, also after SIGINT and SIGTERM; 2 with one line on stderr if
        a parameter, an argument or an input file cannot be used.
    """
    stop = _Stop()
    node = None
    try:
        _init(args)
        node = make_node()
        node.configure()
        stop.starting = False
        node.get_logger().info("ready")
        node.diagnostics.report()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while not (stop.requested or node.stopping.is_set()):
            executor.spin_once(timeout_sec=WAKE_S)
    except KeyboardInterrupt:
        pass
    except InvalidInput as error:
        print(error, file=sys.stderr)
        return BAD_INPUT
    finally:
        stop.starting = False
        if node is not None:
            node.close()
        rclpy.try_shutdown()
    return node.exit_code if node is not None else 0


def _init(args: list[str] | None) -> None:
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:       # what rcl raises for arguments that it cannot parse
        given = sys.argv if args is None else args
        raise InvalidInput("command line", " ".join(given[1:]), f"ROS arguments ({error})") from None
