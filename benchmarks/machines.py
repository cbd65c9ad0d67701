"""Real nodes on the machines of a link, and what is seen of them there."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

from benchmarks.link import ROBOT, Link
from srt3d_ros.nodes.pipeline_probe import Arrival
from srt3d_ros.processes import Process, Processes, node_command, wait

PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
NETWORK_PROFILE = str(Path(__file__).resolve().parents[1] / "config" / "fastdds_network.xml")
WAIT_S = 180.0          # generous: nodes compile, and the machine may be busy


class Machines(Processes):
    """A context manager that ends all that it has started on the machines of a link; NAME.log of each in `folder`."""

    def __init__(self, link: Link, folder: Path):
        super().__init__(folder=folder)
        self.link, self._folder = link, folder

    def start_on(self, machine: str, name: str, profile: str | None = None, **parameters) -> Process:
        """Start a node there, with the Fast DDS profile that it chooses itself or with this one."""
        return self.run(name, self._command(machine, profile, node_command(name, **parameters)))

    def watch(self, topic: str, profile: str | None = None) -> "Watch":
        """See at the robot what arrives on a topic, and all diagnostics."""
        script = str(Path(__file__).with_name("watch.py"))
        seen = Watch()
        self["watch"] = Process(self._command(ROBOT, profile, [sys.executable, script, topic]), seen.on_line)
        return seen

    def wait(self, condition: Callable[[], object], what: str, timeout_s: float = WAIT_S):
        """The condition's value once it is true; TimeoutError, with what the nodes have written, if it never is."""
        def logs() -> str:
            return "\n".join(f"{path.name}: {path.read_text(errors='replace')}" for path in self._folder.glob("*.log"))

        return wait(condition, what, logs, timeout_s)

    def _command(self, machine: str, profile: str | None, command: list[str]) -> list[str]:
        chosen = [f"{PROFILE_VARIABLE}={profile}"] if profile else ["-u", PROFILE_VARIABLE]
        return self.link.command(machine, ["env", *chosen, "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET", *command])


class Watch:
    """What benchmarks/watch.py prints: arrivals, and each node's newest diagnostics."""

    def __init__(self):
        self.arrivals: list[Arrival] = []
        self.reports: dict[str, dict] = {}

    def total(self, name: str, key: str) -> int:
        """A count of a node's newest diagnostics; 0 before the first."""
        return int(self.reports.get(name, {}).get(key, 0))

    def on_line(self, line: str) -> None:
        """Take a line; others than JSON are complaints of Fast DDS."""
        if line.startswith("{"):
            facts = json.loads(line)
            if "node" in facts:
                self.reports[facts["node"]] = facts["values"]
            else:
                self.arrivals.append(Arrival(**facts))
