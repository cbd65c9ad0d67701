"""Nodes as processes of their own, each with a log; none of them outlives the command that starts them."""

import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Container, Iterable
from pathlib import Path

from srt3d_ros.children import AGAIN, Reports, wait_or_kill
from srt3d_ros.cli.node import parameter_arguments
from srt3d_ros.node_names import PLAYER

STOP_TIMEOUT_S = 60.0                   # for a recording and a bag to be written
HAND_OVER_S = 0.3                       # for a node's last messages to reach the next, before that ends as well
READY_TIMEOUT_S = 900.0                 # the reconstructor compiles: on a slow machine with other work, minutes


def join_private_network() -> None:
    """Keep to this machine and clear of any other ROS 2 on it. The nodes inherit it; set before rclpy is imported.

    SIGTERM and SIGHUP then end this process as Ctrl-C does, so that the nodes are ended in order.
    """
    os.environ["ROS_DOMAIN_ID"] = str(random.SystemRandom().randint(1, 100))
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    for ending in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, signal.default_int_handler)


class Node:
    """A node in a process of its own.

    Ctrl-C in a terminal reaches the whole process group of a command: the node has one of its own, so that the command
    can end its nodes one after the other.

    Args:
        say: called with each line that the node prints, in a thread.
        again: whether it takes the place of one that died.
    """

    def __init__(self, name: str, arguments: list[str], say: Callable[[str], None], again: bool = False):
        self.last_words = ""
        self._say, self._reports = say, Reports()
        environment = os.environ | ({AGAIN: "1"} if again else {})
        if sys.stderr.isatty():
            environment.setdefault("RCUTILS_COLORIZED_OUTPUT", "1")
        self._process = self._reports.popen(
            [sys.executable, "-m", "srt3d_ros.cli.main", "node", name, *arguments], environment, process_group=0,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace")
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def code(self) -> int | None:
        """The exit code, negative for a signal; None while the node runs."""
        return self._process.poll()

    @property
    def report(self) -> dict | None:
        """What the node says of itself once it has started (srt3d_ros.nodes.runtime); None before."""
        return self._reports.look()

    def interrupt(self) -> None:
        """Ask it to end, as Ctrl-C does."""
        if self.code is None:
            self._process.send_signal(signal.SIGINT)

    def wait(self, timeout_s: float = STOP_TIMEOUT_S) -> None:
        """Wait until it has ended and has been read to the end; kill it if that takes longer."""
        wait_or_kill(self._process, timeout_s)
        self._reader.join(1.0)
        self._reports.close()

    def how_it_ended(self) -> str:
        """In words."""
        code = self.code or 0
        return f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"

    def _read(self) -> None:
        for line in self._process.stdout:
            self.last_words = line.rstrip("\n")
            self._say(self.last_words)


class Processes:
    """Nodes started by name; a context manager that ends them all, in the order against the flow of data.

    Args:
        folder: where NAME.log is written for each node; None: to stderr, each line after the node's name.
        wait_until: (condition, timeout in seconds) → whether the condition came true.
    """

    def __init__(self, folder: Path | None, wait_until: Callable[[Callable[[], bool], float], bool]):
        self._folder, self._wait_until = folder, wait_until
        self._running: dict[str, Node] = {}
        self._stopping = False
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)

    def __enter__(self) -> "Processes":
        return self

    def __exit__(self, *exc) -> None:
        for node in self._running.values():
            node.interrupt()
        for node in self._running.values():
            node.wait()

    def __getitem__(self, name: str) -> Node:
        return self._running[name]

    def start(self, name: str, **parameters) -> None:
        """Start the node with these ROS parameters."""
        self.start_with(name, parameter_arguments(parameters))

    def start_with(self, name: str, arguments: list[str]) -> None:
        """Start the node with these arguments; once more, if it has been started and has died."""
        if self._folder is None:
            self._running[name] = Node(name, arguments, lambda line: _show(f"[{name}] {line}"), name in self._running)
            return
        log = self.log(name).open("w")
        self._running[name] = Node(name, arguments, lambda line: print(line, file=log, flush=True))

    def log(self, name: str) -> Path:
        """What the node prints."""
        return self._folder / f"{name}.log"

    def ended(self, name: str) -> bool:
        """True if the node was started and is no longer running."""
        return name in self._running and self._running[name].code is not None

    def failed(self) -> list[str]:
        """A line for each node that ended with an error, or before it was asked to."""
        return [f"{name} {node.how_it_ended()}: {node.last_words or 'it said nothing'} ({self.log(name)})"
                for name, node in self._running.items()
                if node.code is not None and not (node.code == 0 and (self._stopping or name == PLAYER))]

    def not_ready(self, names: Iterable[str], reporting: Container[str]) -> list[str]:
        """Wait until all of these nodes are in `reporting`; returns what went wrong, in words."""
        for name in names:
            if not self._wait_until(lambda: name in reporting or self.failed(), READY_TIMEOUT_S):
                return [f"{name} was not ready after {READY_TIMEOUT_S:.0f} s: see {self.log(name)}"]
        return self.failed()

    def stop(self) -> None:
        """End the nodes as Ctrl-C does, the source first and the recorder last, each after it has finished its work."""
        self._stopping = True
        running = [node for node in reversed(self._running.values()) if node.code is None]
        for node in running:
            node.interrupt()
            self._wait_until(lambda: node.code is not None, STOP_TIMEOUT_S)
            if node is not running[-1]:
                time.sleep(HAND_OVER_S)


def _show(line: str) -> None:
    try:
        print(line, file=sys.stderr, flush=True)
    except OSError:         # the terminal was closed
        pass
