"""Programs and nodes as processes: start them, read what they write, wait for it, end them in order."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Container, Iterable
from functools import partial
from pathlib import Path

from srt3d_ros.node_names import PLAYER
from srt3d_ros.parent import AGAIN, PARENT

MAX_REPORT_BYTES = 1 << 16              # a report names a dozen topics
DEADLINE_S = 60.0                       # generous: the machine may be busy; nothing waits longer than it has to
STOP_TIMEOUT_S = 60.0                   # for a recording and a bag to be written
HAND_OVER_S = 0.3                       # for a node's last messages to reach the next, before that ends as well
READY_TIMEOUT_S = 900.0                 # the reconstructor compiles: on a slow machine with other work, minutes
LAST_LINES_S = 5.0                      # for the last lines of a process that has ended
POLL_S = 0.01
SOURCE_TREE = Path(__file__).resolve().parents[1]       # or site-packages


def parameter_arguments(parameters: dict[str, object]) -> list[str]:
    """Parameters as command-line arguments of a node. Values are YAML there, of which JSON is a part."""
    arguments = ["--ros-args"]
    for name, value in parameters.items():
        arguments += ["-p", f"{name}:={json.dumps(value, ensure_ascii=False, default=str)}"]
    return arguments


def node_command(name: str, *ros_args: str, **parameters) -> list[str]:
    """The command that runs a node with these parameters, and other arguments of ROS 2."""
    return [sys.executable, "-m", "srt3d_ros.cli.main", "node", name, *parameter_arguments(parameters), *ros_args]


def wait_until(condition: Callable[[], object], timeout_s: float):
    """The condition's value once it is true, or as it is after `timeout_s`."""
    end = time.monotonic() + timeout_s
    while not (value := condition()) and time.monotonic() < end:
        time.sleep(POLL_S)
    return value


def wait(condition: Callable[[], object], what: str, describe: Callable[[], str] = str,
         deadline_s: float = DEADLINE_S):
    """The condition's value once it is true; TimeoutError names `what` never came, with `describe()`."""
    if not (value := wait_until(condition, deadline_s)):
        raise TimeoutError(f"waited {deadline_s:.0f} s for {what}\n{describe()}".rstrip())
    return value


def wait_or_kill(process: subprocess.Popen, timeout_s: float) -> None:
    """Wait for a process that was asked to end; kill it after `timeout_s`."""
    try:
        process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


class Process:
    """A program that runs. Ctrl-C in the terminal does not reach it: whoever started it ends it.

    Args:
        command: program and arguments. Python finds the srt3d_ros of this process, if that is a source tree, too.
        say: called in a thread with each line that it writes; `lines` then holds only the last one.
        environment: variables beside those of this process.
        is_node: it is a node of this package, which reports its start and ends when this process does.
        stdin: subprocess.PIPE for a program that reads commands, see `tell`.

    Attributes:
        lines: what it has written so far, stdout and stderr.
        killed: whether `kill` ended it.
    """

    def __init__(self, command: list[str], say: Callable[[str], None] | None = None,
                 environment: dict[str, str] | None = None, is_node: bool = False, stdin: int = subprocess.DEVNULL):
        self.command, self.lines, self.killed, self._say = command, [], False, say
        self._report: dict | None = None
        self._connection, childs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._connection.setblocking(False)
        variables = os.environ | {"PYTHONUNBUFFERED": "1"} | (environment or {})
        if (SOURCE_TREE / "setup.py").exists():     # site-packages in PYTHONPATH would come before the standard library
            paths = [variables.get("PYTHONPATH"), str(SOURCE_TREE)]
            variables["PYTHONPATH"] = os.pathsep.join(filter(None, paths))
        if is_node:
            variables[PARENT] = str(childs.fileno())
        with childs:
            self._process = subprocess.Popen(
                command, stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
                env=variables, process_group=0, pass_fds=[childs.fileno()] if is_node else [])
        self.pid = self._process.pid
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def text(self) -> str:
        """All lines."""
        return "\n".join(self.lines)

    @property
    def running(self) -> bool:
        return self.returncode is None

    @property
    def returncode(self) -> int | None:
        """The exit code, negative for the signal that killed it; None while it runs."""
        return self._process.poll()

    @property
    def report(self) -> dict | None:
        """What a node says of itself once it has started (srt3d_ros.nodes.runtime); None before."""
        try:
            while message := self._connection.recv(MAX_REPORT_BYTES):
                self._report = json.loads(message)
        except OSError:         # nothing has come
            pass
        return self._report

    @property
    def ending(self) -> str:
        """How it ended, in words."""
        code = self.returncode or 0
        return f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"

    def says(self, text: str) -> "Process":
        """Wait until it has written this; AssertionError if it ends without."""
        wait(lambda: text in self.text or not self.running, f"{text!r} from {self.command}", lambda: self.text)
        if not self.running:
            self._reader.join(LAST_LINES_S)
        if text not in self.text:
            raise AssertionError(f"{self.command} ended with {self.returncode}:\n{self.text}")
        return self

    def ready(self) -> "Process":
        return self.says("ready")

    def tell(self, line: str) -> None:
        """Write a line to its standard input."""
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def code(self, deadline_s: float = DEADLINE_S) -> int:
        """Wait until it has ended; its exit code."""
        wait(lambda: not self.running, f"the end of {self.command}", lambda: self.text, deadline_s)
        self._reader.join(LAST_LINES_S)
        return self._process.returncode

    def send(self, number: int) -> None:
        """Send a signal, if it still runs."""
        self._process.send_signal(number)

    def halt(self) -> None:
        """SIGSTOP, and wait until none of its threads runs: until one of them has seen the signal, others go on."""
        self.send(signal.SIGSTOP)
        wait(lambda: not self.running or self.halted, f"the halt of {self.command}")

    @property
    def halted(self) -> bool:
        """Whether it exists and none of its threads runs."""
        try:
            stats = [stat.read_text() for stat in Path(f"/proc/{self.pid}/task").glob("*/stat")]
        except OSError:         # a thread has just ended
            return False
        return {stat.rpartition(")")[2].split()[0] for stat in stats} == {"T"}

    def go_on(self) -> None:
        """SIGCONT, after `halt`."""
        self.send(signal.SIGCONT)

    def end(self, number: int) -> int:
        """Send a signal and wait; the exit code."""
        self.send(number)
        return self.code()

    def kill(self) -> None:
        """SIGKILL, and wait."""
        self.killed = True
        self._process.kill()
        self._process.wait()

    def stop(self, number: int = signal.SIGTERM) -> None:
        """End it in order if it can, and read its last lines: a killed process leaves its shared memory behind."""
        self.send(number)
        wait_or_kill(self._process, STOP_TIMEOUT_S)
        self._reader.join(LAST_LINES_S)
        self._connection.close()

    def _read(self) -> None:
        for line in self._process.stdout:
            line = line.rstrip("\n")
            if self._say is not None:
                self.lines.clear()
                self._say(line)
            self.lines.append(line)


class Processes(dict[str, Process]):
    """The newest process of each name; a context manager that ends them all, in the order against the flow of data.

    Args:
        wait_until: (condition, timeout in seconds) → whether the condition came true; what else is to go on meanwhile,
            such as receiving messages, happens in it.
        folder: where NAME.log is written for each process.
        say: called with the name and each line instead.
    """

    def __init__(self, wait_until: Callable[[Callable[[], bool], float], bool] = wait_until,
                 folder: Path | None = None, say: Callable[[str, str], None] | None = None):
        super().__init__()
        self._wait_until, self._folder, self._say = wait_until, folder, say
        self._stopping = False
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)

    def __enter__(self) -> "Processes":
        return self

    def __exit__(self, *exc) -> None:
        for process in self.values():
            process.send(signal.SIGINT)
        for process in self.values():
            process.stop(signal.SIGINT)

    def start(self, name: str, *ros_args: str, **parameters) -> Process:
        """Start the node with these parameters; once more, if it was started and has ended."""
        return self.run(name, node_command(name, *ros_args, **parameters), is_node=True)

    def run(self, name: str, command: list[str], **options) -> Process:
        """Start a program under this name, with options of Process."""
        say = None
        if self._folder is not None:
            say = partial(print, file=self.log(name).open("w"), flush=True)
        elif self._say is not None:
            say = partial(self._say, name)
        if name in self:
            options["environment"] = {AGAIN: "1"} | options.get("environment", {})
        self[name] = Process(command, say, **options)
        return self[name]

    def log(self, name: str) -> Path:
        """What the process writes."""
        return self._folder / f"{name.replace('/', '_')}.log"

    def ended(self, name: str) -> bool:
        """True if the process was started and is no longer running."""
        return name in self and not self[name].running

    def failed(self) -> list[str]:
        """A line for each process that ended with an error, or before it was asked to."""
        return [f"{name} {process.ending}: {(process.lines or ['it said nothing'])[-1]}"
                + (f" ({self.log(name)})" if self._folder else "")
                for name, process in self.items() if not process.running
                and not (process.returncode == 0 and (self._stopping or name == PLAYER))]

    def not_ready(self, names: Iterable[str], reporting: Container[str]) -> list[str]:
        """Wait until all of these nodes are in `reporting`; returns what went wrong, in words."""
        for name in names:
            if not self._wait_until(lambda: name in reporting or self.failed(), READY_TIMEOUT_S):
                return [f"{name} was not ready after {READY_TIMEOUT_S:.0f} s: see {self.log(name)}"]
        return self.failed()

    def stop(self) -> None:
        """End the processes as Ctrl-C does, the newest (the source) first, each after it has finished its work."""
        self._stopping = True
        running = [process for process in reversed(self.values()) if process.running]
        for process in running:
            process.send(signal.SIGINT)
            self._wait_until(lambda: not process.running, STOP_TIMEOUT_S)
            if process is not running[-1]:
                time.sleep(HAND_OVER_S)
