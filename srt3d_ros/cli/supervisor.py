"""Several nodes as one program: started together, watched, and ended in order."""

import signal
import sys
import time

from srt3d_ros import processes
from srt3d_ros.cli.node import node_command

POLL_S = 0.05           # how long a signal or the end of a node may go unnoticed
BAD_INPUT = 2           # a node's exit code for what will not become right by another try
RESTARTED = ("sketcher", "reconstructor")       # they keep nothing that a new process would lack
MOST_RESTARTS, RECENT_S = 5, 60.0               # a node that dies more often in this time will not recover
DELAY_S = 1.0           # before a restart
SIGNALLED = 128         # + number: the exit code of a shell for a process that was ended by a signal


def supervise(names: list[str], ros_args: list[str]) -> int:
    """Run nodes until SIGINT, SIGTERM or SIGHUP, until one is done, or until one fails; then end all.

    Args:
        names: of the nodes, subscribers first; they end in the reverse order.
        ros_args: the same for all.

    Returns:
        0, or the exit code of the node that failed.
    """
    signals, ended, deaths_s = [], "", {name: [] for name in RESTARTED}
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda number, frame: signals.append(number))
    nodes = {name: processes.start(node_command(name, *ros_args)) for name in names}
    while not signals and not ended:
        time.sleep(POLL_S)
        for name in [name for name, node in nodes.items() if node.poll() is not None]:
            recent_s = [died_s for died_s in deaths_s.get(name, ()) if time.monotonic() - died_s < RECENT_S]
            if name not in RESTARTED or nodes[name].returncode in (0, BAD_INPUT) or len(recent_s) == MOST_RESTARTS:
                _say(f"{name} {processes.ending(nodes[name])}: ending all nodes")
                ended = name
                break
            _say(f"{name} {processes.ending(nodes[name])}: it is started again")
            deaths_s[name] = [*recent_s, time.monotonic()]
            time.sleep(DELAY_S)
            nodes[name] = processes.start(node_command(name, *ros_args))
    processes.stop_in_order(reversed(nodes.values()))
    code = nodes[ended].returncode if ended else 0
    return SIGNALLED - code if code < 0 else code or max(0, *(node.returncode for node in nodes.values()))


def _say(text: str) -> None:
    print(f"srt3d up: {text}", file=sys.stderr, flush=True)
