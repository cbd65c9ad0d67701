"""Nodes as child processes: how they are started, watched and ended."""

import ctypes
import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path

STOP_TIMEOUT_S = 60.0       # for a recording and a bag to be written
HAND_OVER_S = 0.3           # for a node's last messages to reach the next, before that ends as well
LIBC, PR_SET_PDEATHSIG = ctypes.CDLL(None), 1       # linux/prctl.h


def parameter_arguments(parameters: dict[str, object]) -> list[str]:
    """Parameters as command-line arguments of a node. Values are YAML there, of which JSON is a part."""
    arguments = ["--ros-args"]
    for name, value in parameters.items():
        arguments += ["-p", f"{name}:={json.dumps(value, ensure_ascii=False, default=str)}"]
    return arguments


def node_command(name: str, *ros_args: str, **parameters) -> list[str]:
    """The command that runs a node with these parameters, and other arguments of ROS 2."""
    return [sys.executable, "-m", "srt3d_ros.cli.main", "node", name, *parameter_arguments(parameters), *ros_args]


def start(command: list[str], **options) -> subprocess.Popen:
    """Start a child that Ctrl-C in the terminal does not reach, and that gets SIGTERM when this process ends."""
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, process_group=0,
                            preexec_fn=lambda: LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGTERM), **options)


def stop(processes: Iterable[subprocess.Popen]) -> None:
    """End processes in this order, each after the one before it has finished its work."""
    for process in processes:
        if process.poll() is None:
            process.terminate()       # SIGINT would be a traceback while Python starts
            wait_or_kill(process, STOP_TIMEOUT_S)
            time.sleep(HAND_OVER_S)


def wait_or_kill(process: subprocess.Popen, timeout_s: float) -> None:
    """Wait for a process that was asked to end; kill it after `timeout_s`."""
    try:
        process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def ending(process: subprocess.Popen | subprocess.CompletedProcess) -> str:
    """How a process ended, in words."""
    code = process.returncode
    return f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"


class LoggedNodes(dict[str, subprocess.Popen]):
    """The newest process of each name; a context manager that ends them, the newest (the source) first.

    Args:
        folder: where NAME.log is written for each.
    """

    def __init__(self, folder: Path):
        super().__init__()
        self._folder, self._stopping = folder, False
        folder.mkdir(parents=True, exist_ok=True)

    def __enter__(self) -> "LoggedNodes":
        return self

    def __exit__(self, *exc) -> None:
        self.stop()

    def start(self, node: str, *ros_args: str, name: str = "", **parameters) -> None:
        """Start a node with these parameters, known by `name` here; once more, if it was started and has ended."""
        with self.log(name or node).open("w") as log:
            self[name or node] = start(node_command(node, *ros_args, **parameters), stdout=log, stderr=log)

    def stop(self) -> None:
        """End the nodes that run."""
        self._stopping = True
        stop(reversed(self.values()))

    def log(self, name: str) -> Path:
        """What the process writes."""
        return self._folder / f"{name.replace('/', '_')}.log"

    def ended(self, name: str) -> bool:
        """Whether the process was started and has ended."""
        return name in self and self[name].poll() is not None

    def failed(self) -> list[str]:
        """A line for each process that ended with an error; SIGTERM of `stop` may end an exiting Python."""
        fine = (None, 0, -signal.SIGTERM) if self._stopping else (None, 0)
        return [f"{name} {ending(process)}: {(self.log(name).read_text().splitlines() or ['it said nothing'])[-1]}"
                f" ({self.log(name)})" for name, process in self.items()
                if process.poll() not in fine]
