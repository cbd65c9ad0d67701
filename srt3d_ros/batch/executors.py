"""Where the frames of a batch are reconstructed: in processes of this machine, or by the workers of a Dask cluster.

Both have `submit(function, *arguments)`, which returns a concurrent.futures.Future, and are closed at the end.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from importlib.util import find_spec
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any

from srt3d_ros import __version__
from srt3d_ros.errors import InvalidInput

SPAWN = multiprocessing.get_context("spawn")        # a fork would inherit the threads' locks, not the threads
TRIES = 2                   # of a frame whose process dies: it may have been chance
CONNECT_S = 10.0
_one_at_a_time = threading.Lock()


class ProcessDied(Exception):
    """The process of a frame ended each time before the frame was done."""


class LocalProcesses:
    """Processes of this machine, each with one frame at a time and its share of the cores.

    Args:
        jobs: how many.
        say: called with a line when one dies.
    """

    def __init__(self, jobs: int, say: Callable[[str], None]):
        self.most_waiting = 2 * jobs        # so that none waits for the next
        self._cores, self._say, self._closed = max(1, len(os.sched_getaffinity(0)) // jobs), say, False
        self._running: list[_Child] = []
        self._idle: SimpleQueue[_Child] = SimpleQueue()
        for _ in range(jobs):
            self._idle.put(self._start())
        self._threads = ThreadPoolExecutor(jobs)

    def submit(self, function: Callable, *arguments: Any) -> Future:
        """Call a function of a module in one of the processes."""
        return self._threads.submit(self._call, function, arguments)

    def close(self) -> None:
        """End the processes, whatever they do."""
        self._closed = True
        for child in self._running:
            child.kill()
        self._threads.shutdown(cancel_futures=True)

    def _start(self) -> "_Child":
        child = _Child(self._cores)
        self._running.append(child)
        return child

    def _call(self, function: Callable, arguments: tuple) -> Any:
        child = self._idle.get()
        try:
            for _ in range(TRIES):
                try:
                    return child.call(function, arguments)
                except (EOFError, OSError):
                    if self._closed:
                        raise
                    ending = child.ending()
                    self._say(f"a process {ending}: another takes its place")
                    self._running.remove(child)
                    child = self._start()
            raise ProcessDied(f"{ending}, {TRIES} times: too little memory?")
        finally:
            self._idle.put(child)


class _Child:
    """A process that answers calls until its connection is closed, be it because this process has died."""

    def __init__(self, cores: int):
        self._connection, childs = SPAWN.Pipe()
        self._process = SPAWN.Process(target=_serve, args=(childs, cores), daemon=True)
        # Ctrl-C reaches the parent, which ends this process; that is not to complain of it, not even while it starts.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        self._process.start()
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        childs.close()

    def call(self, function: Callable, arguments: tuple) -> Any:
        """What the function returns there, or raises; EOFError or OSError if the process dies."""
        self._connection.send((function, arguments))
        result, error = self._connection.recv()
        if error is not None:
            raise error
        return result

    def ending(self) -> str:
        """How it ended, in words."""
        self._process.join()
        code = self._process.exitcode
        return f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"

    def kill(self) -> None:
        self._process.kill()


def _serve(connection: Connection, cores: int) -> None:
    while True:
        try:
            function, arguments = connection.recv()
            connection.send(_answer(function, arguments, cores))
        except (EOFError, OSError):     # the parent has gone
            return


def _answer(function: Callable, arguments: tuple, cores: int) -> tuple[Any, Exception | None]:
    try:
        _use(cores)
        return function(*arguments), None
    except Exception as error:
        return None, error


class DaskCluster:
    """The workers of a Dask cluster, which see the input and the output under the same paths.

    Raises:
        InvalidInput: there is no scheduler at the address.
        ModuleNotFoundError: distributed is not installed.
    """

    most_waiting = 1000     # more than the workers of most clusters; they may come and go

    def __init__(self, address: str, say: Callable[[str], None]):
        from distributed import Client  # here: it takes a second
        from distributed.comm import get_address_host_port

        try:
            get_address_host_port(address)
            self._client = Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InvalidInput("dask", address,
                               f"the address of a scheduler, such as tcp://host:8786 ({error})") from None
        self._executor = self._client.get_executor(pure=False)
        # A worker that cannot import what it is to do ends, and says why in its own log only.
        workers = self._client.run(find_spec, __name__, on_error="return")
        for worker, found in workers.items():
            if found is None or isinstance(found, Exception):
                self.close()
                raise InvalidInput("dask", address, f"workers with srt3d_ros {__version__}, which {worker} has not")
        say(f"{address}: {len(workers)} workers" + " so far" * (not workers))

    def submit(self, function: Callable, *arguments: Any) -> Future:
        """Call a function of a module on one of the workers, on another if that one dies."""
        return self._executor.submit(_on_worker, function, arguments)

    def close(self) -> None:
        """Leave the cluster, which goes on without what was submitted here."""
        self._executor.shutdown(wait=False)
        self._client.close()


def _on_worker(function: Callable, arguments: tuple) -> Any:
    """On a worker: one frame at a time takes all its threads, as each frame is computed by several."""
    from distributed import get_worker

    with _one_at_a_time:
        _use(get_worker().state.nthreads)
        return function(*arguments)


def _use(cores: int) -> None:
    """How many cores the kernels of this thread take."""
    import numba

    numba.set_num_threads(min(cores, numba.config.NUMBA_NUM_THREADS))
