"""Start programs, read what they print, wait for it, and end them: for tests and benchmarks."""

import contextlib
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path

import psutil

DEADLINE_S = 120.0                      # generous, for busy machines; a wait ends as soon as it can
POLL_S, LONGEST_POLL_S = 0.01, 0.1
SOURCE_TREE = Path(__file__).resolve().parents[1]


def wait_until(condition: Callable[[], object], timeout_s: float = DEADLINE_S):
    """Poll a condition, less and less often, until it is true or `timeout_s` has passed; its last value."""
    end, pause_s = time.monotonic() + timeout_s, POLL_S
    while not (value := condition()) and time.monotonic() < end:
        time.sleep(pause_s)
        pause_s = min(1.1 * pause_s, LONGEST_POLL_S)
    return value


def wait(condition: Callable[[], object], what: str, describe: Callable[[], str] = str,
         deadline_s: float = DEADLINE_S):
    """Wait for a condition and return its value. TimeoutError names `what` and ends with `describe()`."""
    if not (value := wait_until(condition, deadline_s)):
        raise TimeoutError(f"waited {deadline_s:.0f} s for {what}\n{describe()}".rstrip())
    return value


def nodes_of(pid: int) -> dict[str, psutil.Process]:
    """The node processes below a process, by node name."""
    found = {}
    for child in psutil.Process(pid).children(recursive=True):
        with contextlib.suppress(psutil.Error):         # the child has just ended
            words = child.cmdline()
            if "node" in words:
                found[words[words.index("node") + 1]] = child
    return found


class Process:
    """A running program in a process group of its own: Ctrl-C in the terminal does not reach it.

    Python imports srt3d_ros from this source tree. `lines` are those of stdout and stderr so far, or only the last one
    if `say` is called with each, in a thread; `killed` says whether `kill` has ended the program.
    """

    def __init__(self, command: list[str], say: Callable[[str], None] | None = None):
        self.command, self.lines, self.killed, self._say = command, [], False, say
        self._process = self._start()
        self.pid = self._process.pid
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _start(self) -> subprocess.Popen:
        variables = os.environ | {"PYTHONUNBUFFERED": "1"}
        variables["PYTHONPATH"] = os.pathsep.join(filter(None, [variables.get("PYTHONPATH"), str(SOURCE_TREE)]))
        return subprocess.Popen(self.command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                stderr=subprocess.STDOUT, text=True, errors="replace", env=variables, process_group=0)

    @property
    def text(self) -> str:
        """All lines so far."""
        return "\n".join(self.lines)

    @property
    def running(self) -> bool:
        return self.returncode is None

    @property
    def returncode(self) -> int | None:
        """The exit code; negative: the signal that killed the program; None while it runs."""
        return self._process.poll()

    def says(self, text: str) -> "Process":
        """Wait until the program prints this text; AssertionError if it ends before."""
        wait(lambda: text in self.text or not self.running, f"{text!r} from {self.command}", lambda: self.text)
        if not self.running:
            self._reader.join(DEADLINE_S)
        if text not in self.text:
            raise AssertionError(f"{self.command} ended with {self.returncode}:\n{self.text}")
        return self

    def ready(self) -> "Process":
        return self.says("ready")

    def code(self, deadline_s: float = DEADLINE_S) -> int:
        """Wait for the end; the exit code."""
        wait(lambda: not self.running, f"the end of {self.command}", lambda: self.text, deadline_s)
        self._reader.join(DEADLINE_S)
        return self.returncode

    def send(self, number: int) -> None:
        """Send a signal if the program still runs."""
        with contextlib.suppress(ProcessLookupError):       # it may have ended since the last poll
            if self.running:
                os.kill(self.pid, number)

    def pause(self) -> None:
        """Send SIGSTOP and wait until every thread has stopped: threads run on until one has seen the signal."""
        self.send(signal.SIGSTOP)
        wait(lambda: not self.running or self._paused(), f"the pause of {self.command}")

    def _paused(self) -> bool:
        try:
            stats = [stat.read_text() for stat in Path(f"/proc/{self.pid}/task").glob("*/stat")]
        except OSError:         # a thread has just ended
            return False
        return {stat.rpartition(")")[2].split()[0] for stat in stats} == {"T"}

    def resume(self) -> None:
        """Send SIGCONT, after `pause`."""
        self.send(signal.SIGCONT)

    def end(self, number: int) -> int:
        """Send a signal and wait for the end; the exit code."""
        self.send(number)
        return self.code()

    def kill(self) -> None:
        """Send SIGKILL and wait for the end."""
        self.killed = True
        self.send(signal.SIGKILL)
        self.code()

    def stop(self, number: int = signal.SIGTERM) -> None:
        """Send a signal; kill the program, which leaves its shared memory behind, only if that does not end it."""
        self.send(number)
        if not wait_until(lambda: not self.running):
            self.kill()
        self._reader.join(DEADLINE_S)

    def _read(self) -> None:
        for line in self._process.stdout:
            line = line.rstrip("\n")
            if self._say is not None:
                self.lines.clear()
                self._say(line)
            self.lines.append(line)
