"""Process: a program in a process of its own, what it writes, and every way to end it."""

import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
DEADLINE_S = 60.0       # generous: the machine may be busy; nothing waits longer than it has to
END_S = 40.0            # for an orderly end: longer than a recorder takes to give up


def wait(condition: Callable[[], object], what: str, describe: Callable[[], str] = str,
         deadline_s: float = DEADLINE_S):
    """The condition's value once it is true; TimeoutError says what never came."""
    end = time.monotonic() + deadline_s
    while not (value := condition()):
        if time.monotonic() > end:
            raise TimeoutError(f"waited {deadline_s:.0f} s for {what}\n{describe()}".rstrip())
        time.sleep(0.01)
    return value


class Process:
    """A program that runs.

    Args:
        command: program and arguments.
        controlled: whether it reads commands on its standard input: see `tell`.
    """

    def __init__(self, command: list[str], controlled: bool = False):
        self.command = command
        self.lines: list[str] = []
        self.killed = False
        path = os.pathsep.join(filter(None, [os.environ.get("PYTHONPATH"), str(REPOSITORY)]))
        environment = {**os.environ, "PYTHONPATH": path, "PYTHONUNBUFFERED": "1"}
        stdin = subprocess.PIPE if controlled else subprocess.DEVNULL
        self._process = subprocess.Popen(command, stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                         text=True, cwd=REPOSITORY, env=environment)
        self.pid = self._process.pid
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in self._process.stdout:
            self.lines.append(line.rstrip())

    @property
    def text(self) -> str:
        """All that it has written, stdout and stderr."""
        return "\n".join(self.lines)

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    @property
    def returncode(self) -> int | None:
        """Its exit code, negative for the signal that killed it; None while it runs."""
        return self._process.poll()

    def says(self, text: str) -> "Process":
        """Wait until it has written this."""
        wait(lambda: text in self.text or not self.running, f"{text!r} from {self.command}", lambda: self.text)
        if not self.running:
            self._reader.join(5)
        if text not in self.text:
            raise AssertionError(f"{self.command} ended with {self.returncode}:\n{self.text}")
        return self

    def ready(self) -> "Process":
        return self.says("ready")

    def tell(self, line: str) -> None:
        """A line on its standard input."""
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def code(self, deadline_s: float = DEADLINE_S) -> int:
        """Wait until it has ended; its exit code."""
        wait(lambda: not self.running, f"the end of {self.command}", lambda: self.text, deadline_s)
        self._reader.join(5)
        return self._process.returncode

    def send(self, number: int) -> None:
        """Send a signal."""
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
        """Send a signal, wait; the exit code."""
        self.send(number)
        return self.code()

    def kill(self) -> None:
        """SIGKILL, and wait."""
        self.killed = True
        self._process.kill()
        self._process.wait()

    def stop(self) -> None:
        """End it for good, in order if it can: a killed process leaves its shared memory behind."""
        if self.running:
            self._process.terminate()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self.kill()
