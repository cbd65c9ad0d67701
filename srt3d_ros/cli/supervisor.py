"""Several nodes as one program: started together, watched, started again when they die, ended in order."""

import os
import signal
import sys
import time
from collections.abc import Callable

from srt3d_ros.node_names import PLAYER
from srt3d_ros.processes import Processes

POLL_S = 0.05           # how long a signal or the end of a node may go unnoticed
BAD_INPUT = 2           # a node's exit code for what will not become right by another try
MOST_RESTARTS = 5       # of a node within RECENT_S: a node that dies more often will not recover
RECENT_S = 60.0
FIRST_DELAY_S = 1.0     # before a restart; doubled for each within RECENT_S: 1, 2, 4, 8, 16 s
SIGNALLED = 128         # + number: the exit code of a shell for a process that was ended by a signal


class Supervisor:
    """Runs nodes until one is done or has failed for good, or until SIGINT, SIGTERM or SIGHUP; ends them in order.

    All start at once but the player, which starts when the others have: what it plays, they see from the beginning.

    Args:
        names: of the nodes, subscribers first.
        arguments: of ROS 2, the same for all.
        on_ready: called once, with what each node reports (srt3d_ros.nodes.runtime), when all have started.
    """

    def __init__(self, names: list[str], arguments: list[str], on_ready: Callable[[dict[str, dict]], None]):
        self._names, self._arguments, self._on_ready = names, arguments, on_ready
        self._ending = False
        self._reports: dict[str, dict] = {}         # of the nodes that have started, in the order of `names`
        self._deaths: dict[str, list[float]] = {name: [] for name in names}
        self._again_at: dict[str, float] = {}       # when nodes that died are to be started again
        self._started: set[str] = set()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, self._on_signal)

    def run(self) -> int:
        """Run them to their end; returns 0, or the exit code of the node that failed."""
        if sys.stderr.isatty():
            os.environ.setdefault("RCUTILS_COLORIZED_OUTPUT", "1")
        with Processes(say=_print_line) as self._nodes:
            for name in self._names:
                if name != PLAYER:
                    self._start(name)
            while not self._ending:
                for name in list(self._started):
                    self._watch(name)
                if len(self._reports) < len(self._names):
                    self._check_ready()
                time.sleep(POLL_S)
            self._nodes.stop()
        codes = [self._nodes[name].returncode for name in self._started - self._again_at.keys()]
        return max((SIGNALLED - code if code < 0 else code for code in codes), default=0)

    def _on_signal(self, number, frame) -> None:
        self._ending = True

    def _start(self, name: str) -> None:
        self._nodes.start(name, *self._arguments)
        self._started.add(name)

    def _check_ready(self) -> None:
        asked = {name: self._nodes[name].report for name in self._names if name in self._started}
        reports = {name: report for name, report in asked.items() if report is not None}
        if len(reports) == len(self._started) < len(self._names):
            self._start(PLAYER)
        if len(reports) == len(self._names):
            self._on_ready(reports)
            self._reports = reports

    def _watch(self, name: str) -> None:
        """Start a node that died again after its delay; end all if it is done, cannot start or died too often."""
        now_s, node = time.monotonic(), self._nodes[name]
        if name in self._again_at:
            if now_s >= self._again_at[name]:
                del self._again_at[name]
                self._start(name)
            return
        if node.running:
            return
        node.stop()         # reads its last lines
        self._deaths[name] = [time_s for time_s in self._deaths[name] if now_s - time_s < RECENT_S] + [now_s]
        died = len(self._deaths[name])
        if node.returncode == 0:
            self._end(f"{name} is done")
        elif node.returncode == BAD_INPUT or node.report is None and died == 1:
            self._end(f"{name} did not start: it {node.ending}")
        elif died > MOST_RESTARTS:
            self._end(f"{name} {node.ending}; it died {died} times within {RECENT_S:.0f} s")
        else:
            delay_s = FIRST_DELAY_S * 2 ** (died - 1)
            self._again_at[name] = now_s + delay_s
            _say(f"{name} {node.ending}: it is started again in {delay_s:.0f} s ({died} of {MOST_RESTARTS})")

    def _end(self, why: str) -> None:
        self._ending = True
        _say(f"{why}: ending all nodes")


def _say(text: str) -> None:
    print(f"srt3d up: {text}", file=sys.stderr, flush=True)


def _print_line(name: str, line: str) -> None:
    try:
        print(f"[{name}] {line}", file=sys.stderr, flush=True)
    except OSError:         # the terminal was closed
        pass
