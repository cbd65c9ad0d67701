"""Nodes as processes of their own, each with a log file; none of them outlives the command that starts them."""

import os
import random
import signal
import subprocess
import sys
from collections.abc import Callable, Container, Iterable
from pathlib import Path

from srt3d_ros.children import wait_or_kill
from srt3d_ros.cli.node import parameter_arguments

STOP_TIMEOUT_S = 20.0
READY_TIMEOUT_S = 900.0                 # the reconstructor compiles: on a slow machine with other work, minutes


def join_private_network() -> None:
    """Keep to this machine and clear of any other ROS 2 on it. The nodes inherit it; set before rclpy is imported.

    SIGTERM and SIGHUP then end this process as Ctrl-C does, so that the nodes are ended in order.
    """
    os.environ["ROS_DOMAIN_ID"] = str(random.SystemRandom().randint(1, 100))
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    for ending in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, signal.default_int_handler)


class Processes:
    """Nodes started by name; a context manager that ends them all, in the order against the flow of data.

    Args:
        folder: where NAME.log is written for each node.
        wait_until: (condition, timeout in seconds) → whether the condition came true.
    """

    def __init__(self, folder: Path, wait_until: Callable[[Callable[[], bool], float], bool]):
        self._folder, self._wait_until = folder, wait_until
        self._running: dict[str, subprocess.Popen] = {}
        self._stopping = False
        folder.mkdir(parents=True, exist_ok=True)

    def __enter__(self) -> "Processes":
        return self

    def __exit__(self, *exc) -> None:
        for process in self._running.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        for process in self._running.values():
            wait_or_kill(process, STOP_TIMEOUT_S)

    def start(self, name: str, **parameters) -> None:
        """Start the node with these ROS parameters."""
        command = [sys.executable, "-m", "srt3d_ros.cli.main", "node", name, *parameter_arguments(parameters)]
        with self.log(name).open("wb") as log:
            self._running[name] = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log)

    def log(self, name: str) -> Path:
        """What the node prints."""
        return self._folder / f"{name}.log"

    def ended(self, name: str) -> bool:
        """True if the node was started and is no longer running."""
        return name in self._running and self._running[name].poll() is not None

    def failed(self) -> list[str]:
        """A line for each node that ended with an error, or before it was asked to."""
        lines = []
        for name, process in self._running.items():
            code = process.poll()
            if code is None or code == 0 and (self._stopping or name == "player"):
                continue
            how = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
            last_words = self.log(name).read_text(errors="replace").split("\n")[-2:][0]
            lines.append(f"{name} {how}: {last_words or 'it said nothing'} ({self.log(name)})")
        return lines

    def not_ready(self, names: Iterable[str], reporting: Container[str]) -> list[str]:
        """Wait until all of these nodes are in `reporting`; returns what went wrong, in words."""
        for name in names:
            if not self._wait_until(lambda: name in reporting or self.failed(), READY_TIMEOUT_S):
                return [f"{name} was not ready after {READY_TIMEOUT_S:.0f} s: see {self.log(name)}"]
        return self.failed()

    def stop(self) -> None:
        """End the nodes as Ctrl-C does, the source first and the recorder last, each after it has finished its work."""
        self._stopping = True
        for process in reversed(self._running.values()):
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
                self._wait_until(lambda: process.poll() is not None, STOP_TIMEOUT_S)
