"""Nodes for tests, which wait for their reports and take their time: reports every 0.1 s, and a long wait for motion.

They are forked from one process that has numba ready, three quarters of the work of a start. rclpy is left to each
node: it starts threads, which a fork does not have.
"""

import atexit
import multiprocessing
import os
import signal
import sys
import threading

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")      # as a node's process has it, before NumPy is loaded

from numba.core.registry import cpu_target

from srt3d_ros import precompile  # noqa: F401
from srt3d_ros.cli import node
from srt3d_ros.core import stream
from srt3d_ros.kernels import cpu  # noqa: F401
from tools.processes import Process

SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload([__name__])
cpu_target.target_context.refresh()


def end_with_parent() -> None:
    """End the node when the tests' process has died."""
    multiprocessing.parent_process().join()
    os.kill(os.getpid(), signal.SIGTERM)


def run(output, code: str, name: str, *arguments: str) -> None:
    """Execute `code`, then be the node of this name with these arguments, and write to the pipe."""
    os.setpgid(0, 0)
    threading.Thread(target=end_with_parent, daemon=True).start()
    for descriptor in (1, 2):
        os.dup2(output.fileno(), descriptor)
    output.close()
    node.exit_at_once_on_signals()
    from srt3d_ros.nodes.common import diagnostics

    diagnostics.PERIOD_S, stream.MOTION_S = 0.1, 30.0
    sys.argv = [name, *arguments]
    try:
        exec(code, {})
        sys.exit(node.start(name, list(arguments)))
    finally:
        atexit._run_exitfuncs()     # which multiprocessing leaves out


class EagerNode(Process):
    """A node that runs. Its command is its name and arguments; its process first executes `code`."""

    def __init__(self, command: list[str], code: str = ""):
        self._code = code
        super().__init__(command)

    def _start(self) -> multiprocessing.Process:
        self._pipe, output = SERVER.Pipe(duplex=False)
        process = SERVER.Process(target=run, args=(output, self._code, *self.command), daemon=True)
        process.start()
        output.close()
        process.stdout = open(self._pipe.fileno(), errors="replace", closefd=False)   # noqa: SIM115
        return process

    @property
    def returncode(self) -> int | None:
        return self._process.exitcode
