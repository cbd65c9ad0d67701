"""`srt3d reconstruct --frames`: each frame of a bag or log to a file, by several processes."""

import multiprocessing
import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent import futures
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from tqdm import tqdm

from srt3d_ros import api
from srt3d_ros.datasets import Photons, readers
from srt3d_ros.datasets.bags.bag import is_bag
from srt3d_ros.datasets.bags.frames import BagFrames
from srt3d_ros.datasets.options import gathered
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.new_files import file_errors
from srt3d_ros.recording import cloud_files
from srt3d_ros.results import Sketch

PROGRESS_S = 0.1 if sys.stderr.isatty() else 10.0       # between two lines of progress in a log
DIED = "memory enough (fewer --jobs take less); the same command goes on"


def reconstruct_frames(path: Path, photons_topic: str, overrides: dict, options: dict, folder: Path, suffix: str,
                       jobs: int) -> dict:
    """Reconstruct all frames into a folder, but those whose file is there; each by itself, whatever was done before.

    Args:
        path, photons_topic, overrides: of a bag or log, as of `srt3d_ros.read`.
        options: of `srt3d_ros.reconstruct`.
        folder, suffix: of the files.
        jobs: processes.

    Returns:
        What became of them: how many frames, of which earlier, done and failed; points; notes.

    Raises:
        InvalidInput: an option, the input or the folder cannot be used, a process died, or the first frame fails.
    """
    with _frames(path, photons_topic, gathered(overrides, path=path.absolute())) as (length, readers):
        files = [folder / f"frame_{number:06d}.{suffix}" for number in range(length)]
        with file_errors("output", folder):
            folder.mkdir(parents=True, exist_ok=True)
        cloud_files.check(folder / f"frame.{suffix}")
        missing = [number for number, file in enumerate(files) if not file.exists()]
        found = {"frames": len(files), "earlier": len(files) - len(missing), "done": 0, "failed": 0, "points": 0,
                 "notes": ()}
        waiting: deque[tuple[int, futures.Future]] = deque()
        bar = tqdm(total=len(files), initial=found["earlier"], unit="frame", mininterval=PROGRESS_S)
        cores = max(1, len(os.sched_getaffinity(0)) // jobs)
        # Spawned: a fork would inherit the threads' locks, not the threads.
        spawned = multiprocessing.get_context("spawn")
        with bar, futures.ProcessPoolExecutor(jobs, spawned, _begin, (cores,)) as executor:
            for number, read in readers:
                if number not in missing:
                    continue
                future = _here(read)
                if future.exception() is None:
                    submit = partial(_submit, executor) if found["done"] else _here      # the first here: it compiles
                    future = submit(save, future.result(), options, files[number])
                waiting.append((number, future))
                if not found["done"] or len(waiting) == 2 * jobs:
                    _count(found, *waiting.popleft(), bar)
            for number, future in waiting:
                _count(found, number, future, bar)
    return found


def _here(function: Callable, *arguments) -> futures.Future:
    """The future of a call that is made in this process."""
    future = futures.Future()
    try:
        future.set_result(function(*arguments))
    except InvalidInput as error:
        future.set_exception(error)
    return future


def _submit(executor: futures.Executor, *call) -> futures.Future:
    """Submit a call; a process that is started for it leaves Ctrl-C to this one, from its first instant."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return executor.submit(*call)
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def _count(found: dict, number: int, future: futures.Future, bar: tqdm) -> None:
    """Wait for a frame and count it; InvalidInput if a process died, or if the first frame fails."""
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


def save(seen: Photons | Sketch, options: dict, file: Path) -> tuple[int, tuple[str, ...]]:
    """Write the cloud of a frame; returns its points, and notes."""
    cloud = api.reconstruct(seen, **options)
    cloud.save(file)
    return len(cloud), cloud.notes


def _begin(cores: int) -> None:
    """In a new process: take its share of the cores, and end with the parent, even if that is killed."""
    import numba

    threading.Thread(target=lambda: multiprocessing.parent_process().join() or os._exit(1), daemon=True).start()
    numba.set_num_threads(min(cores, numba.config.NUMBA_NUM_THREADS))


@contextmanager
def _frames(path: Path, photons_topic: str, options: dict) -> Iterator[tuple]:
    """How many frames the input has, and in their order the number of each with a function that reads it."""
    if is_bag(path):
        with BagFrames(path, photons_topic) as bag:
            yield len(bag), ((frame.number, partial(bag.read, frame, options)) for frame in bag)
        return
    module = readers.module_of(path)
    require(hasattr(module, "frames"), "frames", path.name, "a bag or log of histograms: other files have one frame")
    frames = list(module.frames(path, options))
    yield len(frames), enumerate(partial(frames.__getitem__, number) for number in range(len(frames)))
