"""Several nodes as one program: started together, watched, and ended in order."""

import signal
import sys
import time
from collections.abc import Callable

from srt3d_ros.processes import children
from srt3d_ros.processes.node_arguments import node_command
from srt3d_ros.processes.node_names import FRAMES_LOST, PLAYER

POLL_S = 0.05           # how long a signal or the end of a node may go unnoticed
SIGNALLED = 128         # + number: the exit code of a shell for a process that was ended by a signal


def supervise(names: list[str], ros_args: list[str], on_poll: Callable[[], object] = lambda: None) -> int:
    """Run nodes until SIGINT, SIGTERM or SIGHUP, until one is done, or until one fails; then end all.

    Args:
        names: of the nodes, subscribers first; they end in the reverse order.
        ros_args: the same for all.
        on_poll: called again and again while the nodes run.

    Returns:
        0, or the exit code of the node that failed.
    """
    signals, ended = [], None
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda number, frame: signals.append(number))
    nodes = {name: children.start(node_command(name, *ros_args)) for name in names}
    while not signals and ended is None:
        time.sleep(POLL_S)
        on_poll()
        ended = next((name for name, node in nodes.items() if node.poll() is not None), None)
    if ended is not None:
        print(f"srt3d up: {ended} {children.ending(nodes[ended])}: ending all nodes", file=sys.stderr, flush=True)
    children.stop_in_order(reversed(nodes.values()))
    code = nodes[ended].returncode if ended else 0
    if -code in (signal.SIGINT, signal.SIGTERM):        # a node that was asked to end before it had started
        return 0
    if (ended, code) == (PLAYER, FRAMES_LOST):
        print("srt3d up: frames were lost; the player has said which", file=sys.stderr, flush=True)
    return SIGNALLED - code if code < 0 else code or max(0, *(node.returncode for node in nodes.values()))
