"""Several nodes as one program: started together, watched, and ended in order."""

import signal
import subprocess
import sys
import time
from collections import deque

from srt3d_ros import processes

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
    endings, failed = [], 0
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda number, frame: endings.append(number))
    nodes = {name: _start(name, ros_args) for name in names}
    deaths = {name: deque(maxlen=MOST_RESTARTS) for name in RESTARTED}
    restart_at: dict[str, float] = {}
    while not endings:
        time.sleep(POLL_S)
        now_s = time.monotonic()
        for name in [name for name, at_s in restart_at.items() if now_s >= at_s]:
            del restart_at[name]
            nodes[name] = _start(name, ros_args)
        for name in nodes.keys() - restart_at.keys():
            code = nodes[name].poll()
            if code is None:
                continue
            recent = deaths.get(name)
            often = recent is None or len(recent) == MOST_RESTARTS and now_s - recent[0] < RECENT_S
            if often or code in (0, BAD_INPUT):
                _say(f"{name} {processes.ending(nodes[name])}: ending all nodes")
                endings.append(name)
                failed = SIGNALLED - code if code < 0 else code
                break
            recent.append(now_s)
            restart_at[name] = now_s + DELAY_S
            _say(f"{name} {processes.ending(nodes[name])}: it is started again")
    processes.stop(reversed(nodes.values()))
    return failed or max(0, *(node.returncode for node in nodes.values()))


def _start(name: str, ros_args: list[str]) -> subprocess.Popen:
    return processes.start(processes.node_command(name, *ros_args))


def _say(text: str) -> None:
    print(f"srt3d up: {text}", file=sys.stderr, flush=True)
