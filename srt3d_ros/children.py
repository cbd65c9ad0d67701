"""What a process and those that it starts tell each other, and how they end."""

import json
import os
import signal
import socket
import subprocess
import threading
from dataclasses import dataclass

PARENT = "SRT3D_PARENT_FD"      # in the environment of a child: its end of a connection to who has started it
AGAIN = "SRT3D_STARTED_AGAIN"   # in the environment of a child that takes the place of one that died
MOST_BYTES = 1 << 16            # of a report, which names a dozen topics


def wait_or_kill(process: subprocess.Popen, timeout_s: float) -> None:
    """Wait for a process that has been told to end; after `timeout_s` end it."""
    try:
        process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def started_again() -> bool:
    """Whether this process takes the place of one that died, whose files it must not replace."""
    return AGAIN in os.environ


class Reports:
    """The parent's end of a connection to one child.

    Attributes:
        newest: what the child has reported last, as `look` found it; None before the first report.
    """

    def __init__(self):
        self._own, self._childs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._own.setblocking(False)
        self.newest: dict | None = None

    def popen(self, command: list[str], environment: dict[str, str], **options) -> subprocess.Popen:
        """Start the child, which then has the other end."""
        fd = self._childs.fileno()
        with self._childs:
            return subprocess.Popen(command, env=environment | {PARENT: str(fd)}, pass_fds=[fd], **options)

    def look(self) -> dict | None:
        """`newest`, after taking what has come."""
        try:
            while message := self._own.recv(MOST_BYTES):
                self.newest = json.loads(message)
        except OSError:         # nothing has come
            pass
        return self.newest

    def close(self) -> None:
        """Let a child that still runs end."""
        self._own.close()


@dataclass(frozen=True)
class Parent:
    """The child's end of such a connection."""

    connection: socket.socket

    @staticmethod
    def of_this_process() -> "Parent | None":
        """The parent that waits for reports, if one does. When it ends, this process gets SIGINT, as by Ctrl-C."""
        fd = os.environ.pop(PARENT, "")
        if not fd:
            return None
        parent = Parent(socket.socket(fileno=int(fd)))
        threading.Thread(target=parent._end_with_it, name="parent", daemon=True).start()
        return parent

    def report(self, facts: dict) -> None:
        """Tell it."""
        try:
            self.connection.send(json.dumps(facts).encode())
        except OSError:         # it has ended
            pass

    def _end_with_it(self) -> None:
        try:
            self.connection.recv(1)         # comes back when the other end is closed
        except OSError:
            pass
        os.kill(os.getpid(), signal.SIGINT)
