"""Real nodes on the machines of a link, and what is seen of them there."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from link import ROBOT, Link

from srt3d_ros.processes import parameter_arguments

REPOSITORY = Path(__file__).resolve().parents[1]
PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
NETWORK_PROFILE = str(REPOSITORY / "config" / "fastdds_network.xml")
STOP_TIMEOUT_S = 20
WAIT_S = 180.0          # generous: nodes compile, and the machine may be busy


@dataclass(frozen=True)
class Arrival:
    """A message that arrived: when its frame was acquired, when it came, how long it is."""

    stamp_ns: int
    received_ns: int
    bytes: int

    @property
    def latency_ms(self) -> float:
        return (self.received_ns - self.stamp_ns) * 1e-6


class Machines:
    """A context manager that ends all that it has started.

    Args:
        link: between the machines.
        folder: where NAME.log is written for each node.
    """

    def __init__(self, link: Link, folder: Path):
        self._link, self._folder = link, Path(folder)
        self.running: list[subprocess.Popen] = []

    def __enter__(self) -> "Machines":
        return self

    def __exit__(self, *exc) -> None:
        for process in self.running:
            self._interrupt(process)
        for process in self.running:
            self.stop(process)

    def start(self, machine: str, name: str, profile: str | None = None, **parameters) -> subprocess.Popen:
        """Start a node there, with the Fast DDS profile that it chooses itself or with this one."""
        command = ["-m", "srt3d_ros.cli.main", "node", name, *parameter_arguments(parameters)]
        with (self._folder / f"{name}.log").open("ab") as log:
            return self._start(machine, command, profile, stdout=log, stderr=log)

    def watch(self, topic: str, machine: str = ROBOT, profile: str | None = None) -> "Watch":
        """See there what arrives on a topic, and all diagnostics."""
        script = str(REPOSITORY / "benchmarks" / "watch.py")
        with (self._folder / "watch.log").open("ab") as log:
            return Watch(self._start(machine, [script, topic], profile, stdout=subprocess.PIPE, stderr=log, text=True))

    def stop(self, process: subprocess.Popen) -> None:
        """End it in order, or at once if it does not."""
        self._interrupt(process)
        try:
            process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def logs(self) -> str:
        """What the nodes have written."""
        return "\n".join(f"{path.name}: {path.read_text(errors='replace')}" for path in self._folder.glob("*.log"))

    def wait(self, condition: Callable[[], object], what: str, timeout_s: float = WAIT_S):
        """The condition's value once it is true; TimeoutError, with what the nodes have written, if it never is."""
        end = time.monotonic() + timeout_s
        while not (value := condition()):
            if time.monotonic() > end:
                raise TimeoutError(f"waited {timeout_s:.0f} s for {what}\n{self.logs()}")
            time.sleep(0.01)
        return value

    def _interrupt(self, process: subprocess.Popen) -> None:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)

    def _start(self, machine: str, command: list[str], profile: str | None, **streams) -> subprocess.Popen:
        environment = {**os.environ, "PYTHONPATH": str(REPOSITORY), "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
        environment.pop(PROFILE_VARIABLE, None)
        if profile is not None:
            environment[PROFILE_VARIABLE] = profile
        process = subprocess.Popen(self._link.command(machine, [sys.executable, *command]), stdin=subprocess.DEVNULL,
                                   cwd=REPOSITORY, env=environment, **streams)
        self.running.append(process)
        return process


class Watch:
    """What benchmarks/watch.py says.

    Args:
        process: that runs it.
    """

    def __init__(self, process: subprocess.Popen):
        self.process = process
        self.arrivals: list[Arrival] = []
        self._reports: dict[str, dict] = {}
        threading.Thread(target=self._read, daemon=True).start()

    def reports(self, name: str) -> bool:
        """Whether this node is seen."""
        return name in self._reports

    def value(self, name: str, key: str, otherwise: str = "") -> str:
        """What a node's newest diagnostics say; "level" and "message" are theirs, too."""
        return self._reports.get(name, {}).get(key, otherwise)

    def forget(self, name: str) -> None:
        """Forget what a node has said: it is gone."""
        self._reports.pop(name, None)

    def total(self, name: str, key: str) -> int:
        """A count of a node's newest diagnostics; 0 before the first."""
        return int(self.value(name, key, "0"))

    def _read(self) -> None:
        for line in self.process.stdout:
            if not line.startswith("{"):        # Fast DDS complains there, too
                continue
            said = json.loads(line)
            if "node" in said:
                self._reports[said["node"]] = {"level": said["level"], "message": said["message"], **said["values"]}
            else:
                self.arrivals.append(Arrival(**said))


def resident_mb(process: subprocess.Popen) -> float:
    """The memory that it holds, shared libraries included; 0 once it has ended."""
    try:
        status = Path(f"/proc/{process.pid}/status").read_text()
    except FileNotFoundError:
        return 0.0
    return next((int(line.split()[1]) / 1024 for line in status.splitlines() if line.startswith("VmRSS")), 0.0)
