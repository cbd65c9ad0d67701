"""Nodes for tests, which wait for their reports and take their time: reports every 0.1 s, and a long wait for motion.

They are forked from one process that has numba ready, three quarters of the work of a start. rclpy is left to each
node: it starts threads, which a fork does not have.
"""

import multiprocessing
import os
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")      # as a node's process has it, before NumPy is loaded

from numba.core.registry import cpu_target

from srt3d_ros.cli import node
from srt3d_ros.core import precompile  # noqa: F401
from srt3d_ros.core.sketching import stream
from srt3d_ros.kernels import cpu  # noqa: F401
from tests.processes import Process

SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload([__name__])
cpu_target.target_context.refresh()


def run(output, name: str, ros_args: list[str]) -> None:
    """Be the node, in a process of its own, and write to the pipe."""
    os.setpgid(0, 0)
    for stream_number in (1, 2):
        os.dup2(output.fileno(), stream_number)
    output.close()
    node.exit_at_once_on_signals()
    from srt3d_ros.nodes import diagnostics

    diagnostics.PERIOD_S, stream.MOTION_S = 0.1, 30.0
    sys.exit(node.start(name, ros_args))


class Forked:
    """Of subprocess.Popen, what Process needs."""

    def __init__(self, name: str, *ros_args: str):
        self._pipe, output = SERVER.Pipe(duplex=False)
        self._process = SERVER.Process(target=run, args=(output, name, ros_args), daemon=True)
        self._process.start()
        output.close()
        self.pid, self.kill, self.wait = self._process.pid, self._process.kill, self._process.join
        self.stdout = open(self._pipe.fileno(), errors="replace", closefd=False)

    def poll(self) -> int | None:
        return self._process.exitcode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)


class EagerNode(Process):
    """A node that runs. Its command is its name and arguments."""

    def _start(self) -> Forked:
        return Forked(*self.command)
