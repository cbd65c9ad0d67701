"""Two machines on one: network namespaces joined by a cable, whose rate and loss can be set and which can be pulled.

The machines share the clock and the cores, and nothing else that nodes use: each has its own network interface, its own
addresses and its own /dev/shm. Needs Linux, root, iproute2; one link at a time in a process. Machines starts nodes on
them, and Watch holds what is seen of these there.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from srt3d_ros.processes.node_arguments import node_command
from srt3d_ros.processes.transport import PROFILE_VARIABLE
from tools.processes import Process, wait

SENSOR, ROBOT = "sensor", "robot"           # the machine beside the camera, and the one that reconstructs
ADDRESSES = {SENSOR: "10.77.0.1", ROBOT: "10.77.0.2"}
INTERFACE = "eth0"
QUEUE = "50ms"                              # how long a packet may wait to be sent; longer, and it is dropped
PREFIX = "srt3d_"
SHARED_MEMORY = Path("/dev/shm")
TIMEOUT_S = 10
RANDOM = 2**32 - 0x1000 + 56                # where a packet filter reads a random 32-bit number (SKF_AD_RANDOM)
NETWORK_PROFILE = str(Path(__file__).resolve().parents[1] / "config" / "fastdds_network.xml")
WAIT_S = 180.0          # generous: nodes compile, and the machine may be busy


class Link:
    """A context manager: the machines exist inside it.

    Args:
        rate_mbit: what the cable carries each way, in Mbit/s, counted like `wire_bytes`.

    Raises:
        RuntimeError: something that cannot be made here, with what `ip` or `tc` said about it.
    """

    def __init__(self, rate_mbit: float = 100):
        self._rate_mbit = rate_mbit
        self.names = {machine: f"{PREFIX}{os.getpid()}_{machine}" for machine in ADDRESSES}
        self.shared_memory = SHARED_MEMORY / f"{PREFIX}{os.getpid()}"

    def __enter__(self) -> "Link":
        _remove_orphans()
        try:
            self._make()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *exc) -> None:
        for name in self.names.values():
            _run("ip", "netns", "delete", name, check=False)
        shutil.rmtree(self.shared_memory, ignore_errors=True)

    def command(self, machine: str, command: Sequence[str]) -> list[str]:
        """What runs `command` on that machine, in a process of the same number."""
        enter = 'mount --bind "$0" /dev/shm && exec "$@"'
        return ["ip", "netns", "exec", self.names[machine], "sh", "-c", enter, str(self.shared_memory / machine),
                *command]

    def lose(self, share: float) -> None:
        """Lose this share of the packets each way, each by its own chance: netem's loss, which not every kernel has."""
        keep_below = round((1 - share) * (2**32 - 1))
        program = f"4,32 0 0 {RANDOM},37 0 1 {keep_below},6 0 0 2,6 0 0 0"     # above it: drop (2), else pass (0)
        for name in self.names.values():
            _run("tc", "-n", name, "qdisc", "replace", "dev", INTERFACE, "clsact")
            _run("tc", "-n", name, "filter", "replace", "dev", INTERFACE, "ingress", "prio", "1", "handle", "1",
                 "bpf", "da", "bytecode", program)

    def carry(self, rate_mbit: float) -> None:
        """Carry so much each way from now on, Mbit/s."""
        burst = max(int(rate_mbit * 1e6 / 8 * 1e-3), 4000)      # what a millisecond carries, at least two packets
        for name in self.names.values():
            _run("tc", "-n", name, "qdisc", "replace", "dev", INTERFACE, "root", "tbf", "rate", f"{rate_mbit}mbit",
                 "burst", str(burst), "latency", QUEUE)

    def unplug(self) -> None:
        """Pull the cable out of the robot."""
        _run("ip", "-n", self.names[ROBOT], "link", "set", INTERFACE, "down")

    def plug(self) -> None:
        """Put it in again, and wait until the network is up."""
        _run("ip", "-n", self.names[ROBOT], "link", "set", INTERFACE, "up")
        self._wait_until_up(ROBOT)

    def wire_bytes(self) -> int:
        """What the sensor's machine has sent, bytes of Ethernet frames (without preamble, checksum, gap: 24 each)."""
        return self._interface(SENSOR)["stats64"]["tx"]["bytes"]

    def _interface(self, machine: str) -> dict:
        """What `ip` says about a machine's interface."""
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
            # packets of at most 1500 bytes leave, as from a network card, also where TCP would hand over 64 kB at once
            _run("ip", "-n", name, "link", "set", INTERFACE, "gso_max_segs", "1", "up")
        self.carry(self._rate_mbit)
        for machine in ADDRESSES:       # DDS never uses an interface that was not up when a node started
            self._wait_until_up(machine)
            _run(*self.command(machine, ["true"]))


def watch_command(topic: str) -> list[str]:
    """What runs tools/watch.py."""
    return [sys.executable, str(Path(__file__).with_name("watch.py")), topic]


def why_not() -> str:
    """Why no link can be made here, in a line; empty if one can."""
    try:
        with Link():
            return ""
    except (RuntimeError, OSError) as error:
        return str(error)


def _remove_orphans() -> None:
    """Remove what killed processes left behind."""
    names = [line.split()[0] for line in _run("ip", "netns", "list").splitlines()]
    for name in (*names, *(path.name for path in SHARED_MEMORY.glob(PREFIX + "*"))):
        pid = name.removeprefix(PREFIX).partition("_")[0]
        if name.startswith(PREFIX) and pid.isdigit() and not Path(f"/proc/{pid}").exists():
            _run("ip", "netns", "delete", name, check=False)
            shutil.rmtree(SHARED_MEMORY / name, ignore_errors=True)


def _run(*command: str, check: bool = True) -> str:
    """What the command prints."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S)
    except FileNotFoundError:
        raise RuntimeError(f"{command[0]} is not installed (Debian's package iproute2)") from None
    if check and done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {' '.join(done.stderr.split())}")
    return done.stdout


class Machines(dict[str, Process]):
    """A context manager that ends all that it has started on the machines of a link; NAME.log of each in `folder`."""

    def __init__(self, link: Link, folder: Path):
        super().__init__()
        self.link, self._folder = link, folder
        folder.mkdir(parents=True, exist_ok=True)

    def __enter__(self) -> "Machines":
        return self

    def __exit__(self, *exc) -> None:
        for process in self.values():
            process.send(signal.SIGINT)
        for process in self.values():
            process.stop(signal.SIGINT)

    def start_on(self, machine: str, name: str, profile: str | None = None, **parameters) -> Process:
        """Start a node there, with the Fast DDS profile that it chooses itself or with this one."""
        log = partial(print, file=(self._folder / f"{name}.log").open("w"), flush=True)
        self[name] = Process(self._command(machine, profile, node_command(name, **parameters)), log)
        return self[name]

    def watch(self, topic: str, profile: str | None = None) -> "Watch":
        """See at the robot what arrives on a topic, and all diagnostics."""
        seen = Watch()
        self["watch"] = Process(self._command(ROBOT, profile, watch_command(topic)), seen.on_line)
        return seen

    def wait(self, condition: Callable[[], object], what: str, timeout_s: float = WAIT_S):
        """The condition's value once it is true; TimeoutError, with what the nodes have written, if it never is."""
        def logs() -> str:
            return "\n".join(f"{path.name}: {path.read_text(errors='replace')}" for path in self._folder.glob("*.log"))

        return wait(condition, what, logs, timeout_s)

    def _command(self, machine: str, profile: str | None, command: list[str]) -> list[str]:
        chosen = [f"{PROFILE_VARIABLE}={profile}"] if profile else ["-u", PROFILE_VARIABLE]
        return self.link.command(machine, ["env", *chosen, "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET", *command])


@dataclass(frozen=True)
class Arrival:
    """When a message arrived, and how many points it has."""

    stamp_ns: int
    received_ns: int
    points: int

    @property
    def latency_ms(self) -> float:
        """From the photons' stamp to the arrival."""
        return (self.received_ns - self.stamp_ns) * 1e-6


class Watch:
    """What tools/watch.py prints: arrivals, and each node's newest diagnostics."""

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
