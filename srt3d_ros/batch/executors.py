"""Where the frames of a batch are reconstructed: in processes of this machine, or by the workers of a Dask cluster.

Both have `submit(call)`, which returns a concurrent.futures.Future, and are closed at the end.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from importlib.util import find_spec
from typing import Any, TypeVar

from srt3d_ros import __version__
from srt3d_ros.errors import InvalidInput

SPAWN = multiprocessing.get_context("spawn")        # a fork would inherit the threads' locks, not the threads
CONNECT_S = 10.0
_one_at_a_time = threading.Lock()
Call = TypeVar("Call", bound=Callable[[], Any])


class LocalProcesses:
    """Processes of this machine, each with one frame at a time and its share of the cores.

    When one dies, every call that was submitted ends with BrokenProcessPool; the next one starts new processes.

    Args:
        jobs: how many.
        say: called with a line when one dies.
    """

    def __init__(self, jobs: int, say: Callable[[str], None]):
        self.most_waiting = 2 * jobs        # so that none waits for the next
        self._others = multiprocessing.active_children()
        self._jobs, self._say = jobs, say
        self._pool = self._new_pool()

    def submit(self, call: Callable[[], Any]) -> Future:
        """Begin a call, of a function of a module, in one of the processes."""
        # Block SIGINT in the workers, also while they start: the parent ends them on Ctrl-C.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return self._pool.submit(call)
        except BrokenProcessPool:
            self._say("a process died (too little memory?): others take over")
            self._pool = self._new_pool()
            return self._pool.submit(call)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def close(self) -> None:
        """End the processes, whatever they do."""
        for child in multiprocessing.active_children():
            if child not in self._others:
                child.kill()
        self._pool.shutdown(cancel_futures=True)

    def _new_pool(self) -> ProcessPoolExecutor:
        cores = max(1, len(os.sched_getaffinity(0)) // self._jobs)
        return ProcessPoolExecutor(self._jobs, SPAWN, _begin, (cores,))


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

    def submit(self, call: Callable[[], Any]) -> Future:
        """Begin a call on one of the workers; Dask repeats it on another if that one dies."""
        return self._executor.submit(_on_worker, call)

    def close(self) -> None:
        """Leave the cluster, which goes on without what was submitted here."""
        self._executor.shutdown(wait=False)
        self._client.close()


def done(calls: Iterable[Call], executor: LocalProcesses | DaskCluster) -> Iterator[tuple[Call, Future]]:
    """Each call with its future, as they are done. A call whose process died is repeated once, while no other runs.

    Raises:
        InvalidInput: `calls` raised it; those before it have been given.
    """
    waiting: dict[Future, Call] = {}
    broken = None
    try:
        for call in calls:
            waiting[executor.submit(call)] = call
            if len(waiting) >= executor.most_waiting:
                yield from _some(waiting, executor)
    except InvalidInput as error:
        broken = error
    while waiting:
        yield from _some(waiting, executor)
    if broken is not None:
        raise broken


def _some(waiting: dict[Future, Call], executor: LocalProcesses | DaskCluster) -> Iterator[tuple[Call, Future]]:
    """Wait for some of these and take them out."""
    ended = wait(waiting, return_when=FIRST_COMPLETED).done
    if any(map(_died, ended)):
        ended = wait(waiting).done      # a broken pool fails all its calls: repeat none before the last has ended
    for future in [future for future in waiting if future in ended]:
        call = waiting.pop(future)
        if _died(future):
            future = executor.submit(call)
            wait([future])
        yield call, future


def _died(future: Future) -> bool:
    return not future.cancelled() and isinstance(future.exception(), BrokenProcessPool)


def _on_worker(call: Callable[[], Any]) -> Any:
    """On a worker: one frame at a time takes all its threads, as each frame is computed by several."""
    from distributed import get_worker

    with _one_at_a_time:
        _use(get_worker().state.nthreads)
        return call()


def _begin(cores: int) -> None:
    """In a new process: take its share of the cores, and end with the parent, even if that is killed."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _use(cores)


def _end_with_parent() -> None:
    multiprocessing.parent_process().join()
    os._exit(1)


def _use(cores: int) -> None:
    """How many cores the kernels of this thread take."""
    import numba

    numba.set_num_threads(min(cores, numba.config.NUMBA_NUM_THREADS))
