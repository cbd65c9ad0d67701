"""`srt3d reconstruct --frames`: each frame of a bag or log to a file, by processes or a Dask cluster."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent import futures
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from tqdm import tqdm

from srt3d_ros import api
from srt3d_ros.datasets import Photons
from srt3d_ros.datasets.bags.bag import is_bag
from srt3d_ros.datasets.bags.frames import BagFrames
from srt3d_ros.datasets.photons import gather_options
from srt3d_ros.datasets.readers import histogram_logs
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.new_files import file_errors
from srt3d_ros.recording import cloud_files
from srt3d_ros.request import Request
from srt3d_ros.results import Sketch

ALL = "all"
PROGRESS_S = 0.1 if sys.stderr.isatty() else 10.0       # between two lines of progress in a log
CONNECT_S = 10.0
WAITING = 200               # frames sent to a cluster at once: more than most have workers
DIED = "memory enough (fewer --jobs take less), a cluster that stays; the same command goes on"
_one_at_a_time = threading.Lock()       # a frame is computed by several threads: those of a Dask worker take turns


def reconstruct_frames(request: Request, frames: str, folder: Path, suffix: str, jobs: int, dask: str | None) -> dict:
    """Reconstruct frames, "all" or "FIRST:LAST", into a folder, but those whose file is there.

    Returns:
        What became of them: how many frames, of which earlier, done and failed; points; notes.

    Raises:
        InvalidInput: an option, the input or the folder cannot be used, a process died, or the first frame fails.
    """
    most = WAITING if dask else 2 * jobs
    found = {"frames": 0, "earlier": 0, "done": 0, "failed": 0, "points": 0, "notes": ()}
    waiting: dict[futures.Future, int] = {}

    def collect() -> None:
        """Count the frames that are done or have failed; wait for the first."""
        for future in futures.wait(waiting, return_when=futures.FIRST_COMPLETED).done:
            number = waiting.pop(future)
            try:
                points, notes = future.result()
                found.update(done=found["done"] + 1, points=found["points"] + points, notes=notes)
            except InvalidInput as error:
                if found["done"] + found["earlier"] == 0:       # an option, say, that is wrong for all frames
                    raise
                found["failed"] += 1
                tqdm.write(f"srt3d: frame {number}: {error}", file=sys.stderr)
            except (futures.BrokenExecutor, futures.CancelledError):
                raise InvalidInput("reconstruction", "ended with one of its processes", DIED) from None
            bar.update()

    with _frames(request) as (length, readers):
        files = {number: folder / f"frame_{number:06d}.{suffix}" for number in _numbers(frames, length)}
        with file_errors("output", folder):
            folder.mkdir(parents=True, exist_ok=True)
        cloud_files.check(files[min(files)])
        found.update(frames=len(files), earlier=sum(file.exists() for file in files.values()))
        bar = tqdm(total=len(files), initial=found["earlier"], unit="frame", mininterval=PROGRESS_S)
        with bar, _executor(jobs, dask) as executor:
            for number, read in readers:
                if number > max(files):
                    break
                if number in files and not files[number].exists():
                    future = _here(read)
                    if future.exception() is None:
                        submit = executor.submit if found["done"] else _here    # the first here: it compiles
                        future = submit(save, request, future.result(), files[number])
                    waiting[future] = number
                    while len(waiting) >= (most if found["done"] else 1):
                        collect()
            while waiting:
                collect()
    return found


def _here(function: Callable, *arguments) -> futures.Future:
    """The future of a call that is made in this process."""
    future = futures.Future()
    try:
        future.set_result(function(*arguments))
    except InvalidInput as error:
        future.set_exception(error)
    return future


def save(request: Request, seen: Photons | Sketch, file: Path) -> tuple[int, tuple[str, ...]]:
    """Write the cloud of a frame; returns its points, and notes."""
    with _one_at_a_time:
        cloud = request.cloud(seen)
        cloud.save(file)
    return len(cloud), cloud.notes


@contextmanager
def _executor(jobs: int, dask: str | None) -> Iterator[futures.Executor]:
    if dask is None:
        cores = max(1, len(os.sched_getaffinity(0)) // jobs)
        # Spawned: a fork would inherit the threads' locks, not the threads.
        executor = futures.ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), _begin, (cores,))
        try:
            yield executor
        finally:
            executor.shutdown(cancel_futures=True)
        return
    from distributed import Client  # here: it takes a second

    try:
        client = Client(dask, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InvalidInput("dask", dask, f"the address of a scheduler, such as tcp://host:8786 ({error})") from None
    with client:
        yield client.get_executor(pure=False)


def _begin(cores: int) -> None:
    """In a new process: take its share of the cores, leave Ctrl-C to the parent, and end with it, even if killed."""
    import numba

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=lambda: multiprocessing.parent_process().join() or os._exit(1), daemon=True).start()
    numba.set_num_threads(min(cores, numba.config.NUMBA_NUM_THREADS))


@contextmanager
def _frames(request: Request) -> Iterator[tuple]:
    """How many frames the input has, and in their order the number of each with a function that reads it."""
    path = request.input
    if is_bag(path):
        with BagFrames(path, request.photons_topic) as bag:
            yield len(bag), ((place.number, partial(api.open_frame, bag, place, request.overrides))
                             for place in bag.places())
        return
    require(histogram_logs.is_log(path), "frames", path.name, "a bag or log of histograms: other files have one frame")
    frames = list(histogram_logs.frames(path, gather_options(path, request.overrides)))
    yield len(frames), enumerate(partial(frames.__getitem__, number) for number in range(len(frames)))


def _numbers(frames: str, length: int) -> range:
    """The numbers of "all" frames, or of FIRST:LAST."""
    first, mark, last = (0, ":", length - 1) if frames == ALL else frames.partition(":")
    fits = frames == ALL or mark and first.isdecimal() and last.isdecimal() and int(first) <= int(last) < length
    require(fits, "frames", frames, f"{ALL}, or first and last such as 0:{length - 1}, the last there is")
    return range(int(first), int(last) + 1)
