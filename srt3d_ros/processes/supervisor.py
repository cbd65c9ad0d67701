"""Runs several nodes as one program: starts, watches and stops them in order."""

import signal
import sys
import time
from collections.abc import Callable

from srt3d_ros.processes import children
from srt3d_ros.processes.node_command import FRAMES_LOST, PLAYER, node_command

POLL_CHILDREN_S = 0.05           # longest time until a signal or the end of a node is noticed
SIGNALLED = 128         # plus the signal's number: a shell's exit code for a process ended by a signal


def supervise(names: list[str], ros_args: list[str], on_poll: Callable[[], object] = lambda: None) -> int:
    """Run nodes until SIGINT, SIGTERM or SIGHUP, or until one of them ends; then stop all.

    Args:
        names: the nodes, subscribers first; they are stopped in the reverse order.
        ros_args: arguments for ROS 2, the same for all nodes.
        on_poll: called every POLL_CHILDREN_S while the nodes run.

    Returns:
        0, or the exit code of the node that failed.
    """
    signals, ended = [], None
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda number, frame: signals.append(number))
    nodes = {name: children.start(node_command(name, *ros_args)) for name in names}
    while not signals and ended is None:
        time.sleep(POLL_CHILDREN_S)
        on_poll()
        ended = next((name for name, node in nodes.items() if node.poll() is not None), None)
    if ended is not None:
        print(f"srt3d up: {ended} {children.ending(nodes[ended])}: stopping all nodes", file=sys.stderr, flush=True)
    children.stop_in_order(reversed(nodes.values()))
    code = nodes[ended].returncode if ended else 0
    if -code in (signal.SIGINT, signal.SIGTERM):        # the node got the signal before it had started
        return 0
    if (ended, code) == (PLAYER, FRAMES_LOST):
        print("srt3d up: frames were lost; see the player's last line", file=sys.stderr, flush=True)
    if code < 0:
        return SIGNALLED - code
    return code or max(0, *(node.returncode for node in nodes.values()))
