"""Two machines simulated on one, for tests and benchmarks: network namespaces joined by a cable.

The cable has a rate, can lose packets, and can be unplugged for a moment. The machines share the clock and the cores;
each has its own network interface, address and /dev/shm. `Machines` starts nodes on them, and `Watch` keeps what the
robot receives. Needs Linux, root and iproute2; one `Link` at a time in a process.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import NamedTuple

from srt3d_ros.processes.node_command import node_command
from srt3d_ros.processes.transport import FAST_DDS
from tools.processes import Process, wait

SENSOR, ROBOT = "sensor", "robot"           # the machine at the camera, and the one that reconstructs
ADDRESSES = {SENSOR: "10.77.0.1", ROBOT: "10.77.0.2"}
INTERFACE = "eth0"
QUEUE = "50ms"                              # a packet that would wait longer to be sent is dropped
PREFIX = "srt3d_"
SHARED_MEMORY = Path("/dev/shm")
TIMEOUT_S = 10
RANDOM = 2**32 - 0x1000 + 56                # address of a random 32-bit number in a BPF program (SKF_AD_RANDOM)
NETWORK_PROFILE = str(Path(__file__).resolve().parents[1] / FAST_DDS.profiles.format("network"))
WAIT_S = 180.0                              # generous: nodes compile, and the machine may be busy


class Link:
    """A context manager, inside which both machines and the cable exist.

    `rate_mbit` is the cable's in each direction, Mbit/s, counted like `wire_bytes`. RuntimeError: `ip` or `tc` failed.
    """

    def __init__(self, rate_mbit: float = 100):
        self._rate_mbit = rate_mbit
        self.names = {machine: f"{PREFIX}{os.getpid()}_{machine}" for machine in ADDRESSES}
        self.shared_memory = SHARED_MEMORY / f"{PREFIX}{os.getpid()}"

    def __enter__(self) -> "Link":
        with ExitStack() as undo:
            undo.callback(self.__exit__)
            self._make()
            undo.pop_all()
        return self

    def __exit__(self, *exc) -> None:
        for name in self.names.values():
            _run("ip", "netns", "delete", name, check=False)
        shutil.rmtree(self.shared_memory, ignore_errors=True)

    def command(self, machine: str, command: Sequence[str]) -> list[str]:
        """The command line that runs `command` on a machine (with exec, so that its process id is the same)."""
        enter = 'mount --bind "$0" /dev/shm && exec "$@"'
        return ["ip", "netns", "exec", self.names[machine], "sh", "-c", enter, str(self.shared_memory / machine),
                *command]

    def lose(self, share: float) -> None:
        """Drop this share of the packets in each direction at random. Kernels without netem can do this, too."""
        keep_below = round((1 - share) * (2**32 - 1))
        program = f"4,32 0 0 {RANDOM},37 0 1 {keep_below},6 0 0 2,6 0 0 0"     # drop (2) above it, else pass (0)
        for name in self.names.values():
            _run("tc", "-n", name, "qdisc", "replace", "dev", INTERFACE, "clsact")
            _run("tc", "-n", name, "filter", "replace", "dev", INTERFACE, "ingress", "prio", "1", "handle", "1",
                 "bpf", "da", "bytecode", program)

    def replug(self) -> None:
        """Unplug the cable from the robot, plug it in again, and wait until the network is up."""
        for state in ("down", "up"):
            _run("ip", "-n", self.names[ROBOT], "link", "set", INTERFACE, state)
        self._wait_until_up(ROBOT)

    def wire_bytes(self) -> int:
        """Bytes of Ethernet frames that the sensor's machine has sent, without the 24 of preamble, checksum and gap."""
        return self._interface(SENSOR)["stats64"]["tx"]["bytes"]

    def _interface(self, machine: str) -> dict:
        """The state of a machine's interface, from `ip`."""
        return json.loads(_run("ip", "-n", self.names[machine], "-s", "-json", "link", "show", "dev", INTERFACE))[0]

    def _wait_until_up(self, machine: str) -> None:
        wait(lambda: self._interface(machine)["operstate"] == "UP", f"{INTERFACE} of {machine}", deadline_s=TIMEOUT_S)

    def _make(self) -> None:
        for machine, name in self.names.items():
            (self.shared_memory / machine).mkdir(parents=True)
            _run("ip", "netns", "add", name)
        one, other = self.names.values()
        _run("ip", "link", "add", INTERFACE, "netns", one, "type", "veth", "peer", "name", INTERFACE, "netns", other)
        for machine, name in self.names.items():
            _run("ip", "-n", name, "address", "add", f"{ADDRESSES[machine]}/24", "dev", INTERFACE)
            _run("ip", "-n", name, "link", "set", "lo", "up")
            # packets have at most 1500 bytes, as from a network card, even if TCP hands over 64 kB at once
            _run("ip", "-n", name, "link", "set", INTERFACE, "gso_max_segs", "1", "up")
            burst = max(int(self._rate_mbit * 1e6 / 8 * 1e-3), 4000)        # bytes of 1 ms, at least two packets
            _run("tc", "-n", name, "qdisc", "replace", "dev", INTERFACE, "root", "tbf", "rate",
                 f"{self._rate_mbit}mbit", "burst", str(burst), "latency", QUEUE)
        for machine in ADDRESSES:       # DDS ignores an interface that is not up when a node starts
            self._wait_until_up(machine)
            _run(*self.command(machine, ["true"]))


def watch_command(topic: str) -> list[str]:
    """The command line that runs tools/watch.py for a topic."""
    return [sys.executable, str(Path(__file__).with_name("watch.py")), topic]


def _run(*command: str, check: bool = True) -> str:
    """Run a command; its output."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S)
    except FileNotFoundError:
        raise RuntimeError(f"{command[0]} is not installed (Debian's package iproute2)") from None
    if check and done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {' '.join(done.stderr.split())}")
    return done.stdout


class Machines(dict[str, Process]):
    """Starts nodes on the machines of a link, each with a log NAME.log in `folder`; ends them when the block ends."""

    def __init__(self, link: Link, folder: Path):
        super().__init__()
        self.link, self._folder = link, folder
        folder.mkdir(parents=True, exist_ok=True)

    def __enter__(self) -> "Machines":
        return self

    def __exit__(self, *exc) -> None:
        for end in (Process.send, Process.stop):
            for process in self.values():
                end(process, signal.SIGINT)

    def start_on(self, machine: str, name: str, profile: str | None = None, **parameters) -> Process:
        """Start a node on a machine, with this Fast DDS profile or the one that it chooses itself."""
        log = partial(print, file=(self._folder / f"{name}.log").open("w"), flush=True)
        self[name] = Process(self._command(machine, profile, node_command(name, **parameters)), log)
        return self[name]

    def watch(self, topic: str) -> "Watch":
        """Start to collect, at the robot, the arrivals on a topic and the diagnostics of all nodes."""
        seen = Watch()
        self["watch"] = Process(self._command(ROBOT, None, watch_command(topic)), seen.on_line)
        return seen

    def wait(self, condition: Callable[[], object], what: str, timeout_s: float = WAIT_S):
        """Wait for a condition and return its value. TimeoutError has the logs of the nodes."""
        def logs() -> str:
            return "\n".join(f"{path.name}: {path.read_text(errors='replace')}" for path in self._folder.glob("*.log"))

        return wait(condition, what, logs, timeout_s)

    def _command(self, machine: str, profile: str | None, command: list[str]) -> list[str]:
        variable = FAST_DDS.variables[0]
        chosen = [f"{variable}={profile}"] if profile else ["-u", variable]
        return self.link.command(machine, ["env", *chosen, "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET", *command])


class Arrival(NamedTuple):
    """When a message was stamped and received."""

    stamp_ns: int
    received_ns: int

    @property
    def latency_ms(self) -> float:
        return (self.received_ns - self.stamp_ns) * 1e-6


class Watch:
    """The output of tools/watch.py: all arrivals, and the newest diagnostics of each node."""

    def __init__(self):
        self.arrivals: list[Arrival] = []
        self.reports: dict[str, dict] = {}

    def total(self, name: str, key: str) -> int:
        """A count from the newest diagnostics of a node; 0 before the first."""
        return int(self.reports.get(name, {}).get(key, 0))

    def on_line(self, line: str) -> None:
        """Take in a line of output. Lines that are not JSON are warnings of Fast DDS."""
        if line.startswith("{"):
            facts = json.loads(line)
            if "node" in facts:
                self.reports[facts["node"]] = facts["values"]
            else:
                self.arrivals.append(Arrival(**facts))
