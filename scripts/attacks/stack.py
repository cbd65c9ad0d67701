"""What the attacks share: a pipeline of real processes, and the frame accounting of its nodes.

    with Stack({"recorder": {"path": …}}) as stack:         # sketcher, reconstructor, and what else is named
        stack.start("player", input="simulator")
        stack.processes["sketcher"].kill()
        stack.start("sketcher")
        stack.wait(lambda: stack.monitor.arrivals, "a cloud")
        stack.settle(["sketcher", "reconstructor"])         # what does not add up once nothing more comes
"""

import sys
import time
from collections import Counter
from collections.abc import Callable

from process import Process

from srt3d_ros.cli.node import parameter_arguments
from srt3d_ros.nodes.pipeline_probe import PipelineProbe

READY_S = 180.0             # the first start on a machine compiles
BALANCE_S = 20.0            # until all that was under way has arrived and is reported; a node reports once a second
PIPELINE = ("reconstructor", "sketcher")        # who listens, before who speaks
UNSETTLED = ("unaccounted_frames", "unaccounted_photons", "under_way", "photons_under_way")
Values = dict[str, str]


class ReportedCounts:
    """Totals of every node over all its restarts, from its reports."""

    def __init__(self):
        self.latest: dict[str, Values] = {}
        self._before: dict[str, Counter[str]] = {}      # of the processes that this node had before
        self._at: dict[str, float] = {}

    def take(self, name: str, values: Values) -> None:
        """A node's newest report."""
        if int(values["frames_in"]) < int(self.latest.get(name, values)["frames_in"]):
            self.restarted(name)
        self.latest[name], self._at[name] = values, time.monotonic()

    def restarted(self, name: str) -> None:
        """A node begins to count at 0 again."""
        if name in self.latest:
            self._before.setdefault(name, Counter()).update(counts(self.latest.pop(name)))

    def age_s(self, name: str) -> float:
        """Since a node's newest report."""
        return time.monotonic() - self._at.get(name, 0.0)

    def totals(self, name: str) -> Counter[str]:
        """What a node and those before it counted: frames_in, frames_out, message_lost, dropped.CAUSE, …"""
        return self._before.get(name, Counter()) + counts(self.latest.get(name, {}))

    def losses(self) -> Counter[str]:
        """Frames that were lost, by "node: cause"."""
        lost = Counter()
        for name in {*self.latest, *self._before}:
            lost.update({f"{name}: {key.removeprefix('dropped.')}": n for key, n in self.totals(name).items()
                         if n and (key.startswith("dropped.") or key == "message_lost")})
        return lost


def counts(values: Values) -> Counter[str]:
    """The whole numbers of a report; rates and words are left out."""
    return Counter({key: int(value) for key, value in values.items() if value.isdecimal()})


def under_way(values: Values) -> int:
    """What a report does not account for, or what still waits: 0 when nothing more comes and all is well."""
    return sum(abs(int(values[key])) for key in UNSETTLED if key in values)


class Stack:
    """A context manager: the nodes run inside it.

    Args:
        nodes: that are started with it, besides sketcher and reconstructor or with parameters of theirs, by name.
    """

    def __init__(self, nodes: dict[str, dict] | None = None):
        self.parameters: dict[str, dict] = dict.fromkeys(PIPELINE, {}) | (nodes or {})
        self.processes: dict[str, Process] = {}
        self.ended: list[tuple[str, Process]] = []      # processes that were replaced, for their last words
        self.counts = ReportedCounts()
        self.monitor = PipelineProbe(keep_every=10**9)

    def __enter__(self) -> "Stack":
        self.monitor.__enter__()
        try:
            for name in self.parameters:
                self.start(name, wait=False)
            for name in self.parameters:
                self.ready(name)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *exc) -> None:
        """Ends all, the source first."""
        for process in reversed(self.processes.values()):
            process.stop()
        self.monitor.__exit__()

    def start(self, name: str, wait: bool = True, node: str = "", **parameters) -> Process:
        """Start a node, or start it again; `node` is its kind where that is not its name."""
        if name in self.processes:
            assert not self.processes[name].running, f"{name} runs already"
            self.ended.append((name, self.processes[name]))
        self.spin(0.0)
        self.counts.restarted(name)
        self.monitor.statuses.pop(name, None)
        given = self.parameters.get(name, {}) | parameters
        renamed = ["-r", f"__node:={name}"] if node else []
        command = [sys.executable, "-m", "srt3d_ros.cli.main", "node", node or name]
        self.processes[name] = Process([*command, *parameter_arguments(given), *renamed])
        if wait:
            self.ready(name)
        return self.processes[name]

    def ready(self, name: str) -> None:
        """Wait until a node is; AssertionError if it ends instead."""
        process = self.processes[name]
        self.wait(lambda: "ready" in process.text or not process.running, f"{name} to be ready", READY_S)
        assert process.running, f"{name} ended with {process.returncode}:\n{process.text}"

    def run(self, name: str, command: list[str], controlled: bool = False) -> Process:
        """Start a program that is no node of the pipeline."""
        if name in self.processes:
            self.ended.append((name, self.processes[name]))
        self.processes[name] = Process([sys.executable, *command], controlled)
        return self.processes[name]

    def leave(self, name: str) -> None:
        """A process that is to be there no more."""
        self.ended.append((name, self.processes.pop(name)))

    def spin(self, seconds: float) -> None:
        """Receive for so long."""
        self.wait(lambda: False, "", seconds, must=False)

    def wait(self, condition: Callable[[], object], what: str, timeout_s: float = BALANCE_S, must: bool = True) -> bool:
        """Receive until the condition holds; TimeoutError says what never came, unless it need not."""
        def seen() -> bool:
            for name, values in self.monitor.statuses.items():
                if values is not self.counts.latest.get(name):
                    self.counts.take(name, values)
            return bool(condition())

        met = self.monitor.spin_until(seen, timeout_s)
        if must and not met:
            raise TimeoutError(f"waited {timeout_s:.0f} s for {what}")
        return met

    def value(self, name: str, key: str) -> str:
        """Of a node's newest report."""
        return self.counts.latest.get(name, {}).get(key, "")

    def dead(self) -> list[str]:
        """A line for each process that ended."""
        return [f"{name} ended with {process.returncode}: {(process.lines or ['it said nothing'])[-1]}"
                for name, process in self.processes.items() if not process.running]

    def unbalanced(self, names: list[str]) -> dict[str, int]:
        """Nodes whose frame accounting does not add up just now."""
        return {name: amount for name in names
                if (amount := under_way(self.counts.latest[name]) if name in self.counts.latest else -1)}

    def settle(self, names: list[str], timeout_s: float = BALANCE_S) -> dict[str, int]:
        """Wait, with nothing more coming in, until these nodes account for every frame; returns those that do not."""
        since = time.monotonic()

        def settled() -> bool:
            fresh = all(self.counts.age_s(name) < time.monotonic() - since for name in names)
            return fresh and not self.unbalanced(names)

        self.wait(settled, "", timeout_s, must=False)
        return self.unbalanced(names)
