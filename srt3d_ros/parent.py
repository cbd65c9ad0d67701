"""A node's end of the connection to the process that started it (srt3d_ros.processes)."""

import json
import os
import signal
import socket
import threading
from dataclasses import dataclass

PARENT = "SRT3D_PARENT_FD"      # in the environment of a node: the number of its end of the connection
AGAIN = "SRT3D_STARTED_AGAIN"   # in the environment of a node that replaces one that died


def started_again() -> bool:
    """Whether this process replaces one that died, whose files it must not overwrite."""
    return AGAIN in os.environ


@dataclass(frozen=True)
class Parent:
    connection: socket.socket

    @staticmethod
    def of_this_process() -> "Parent | None":
        """The parent that waits for a report, if one does. When it ends, this process gets SIGINT, as by Ctrl-C."""
        fd = os.environ.pop(PARENT, "")
        if not fd:
            return None
        parent = Parent(socket.socket(fileno=int(fd)))
        threading.Thread(target=parent._end_with_it, name="parent", daemon=True).start()
        return parent

    def report(self, facts: dict) -> None:
        """Send it what it is to know of this process."""
        try:
            self.connection.send(json.dumps(facts).encode())
        except OSError:         # it has ended
            pass

    def _end_with_it(self) -> None:
        try:
            self.connection.recv(1)         # returns when the other end is closed
        except OSError:
            pass
        os.kill(os.getpid(), signal.SIGINT)
