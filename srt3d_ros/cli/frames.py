"""`srt3d reconstruct --frames`: each frame into a file of its own, on this machine's cores or on a Dask cluster."""

import argparse
import concurrent.futures
import json
import os
import re
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from threading import Lock

from srt3d_ros.cli import common
from srt3d_ros.errors import InvalidInput, printable, require
from srt3d_ros.files.new_files import atomic_write, check_not_input, file_errors
from srt3d_ros.progress import progress

RANGE = re.compile(r"(\d{1,9})[-:](\d{1,9})")
CLOUD_FILE = re.compile(r"\d{6,}\.")
ADDRESS = re.compile(r"\w+://.+:\d+")
CONNECT_S = 10          # until a scheduler answers, and until it has a worker
AHEAD = 2               # frames read for each worker, so that none waits for the next one
OPTIONS_FILE = "options.json"
OF_THE_RUN = ("output", "frame", "frames", "format", "jobs", "dask", "json", "run")     # arguments that change no cloud
FAILED = 1
ONE_AT_A_TIME = Lock()      # a worker of Dask may have several threads, but a frame uses them all


@dataclass(frozen=True)
class Task:
    """A frame to reconstruct into a file: `load` reads it, `options` are those of api.reconstruct."""

    number: int
    load: Callable
    options: dict
    output: Path
    threads: int

    def __call__(self) -> tuple[str, ...]:
        """Write the cloud; returns its notes."""
        from numba import config, set_num_threads

        from srt3d_ros import api

        with ONE_AT_A_TIME:
            set_num_threads(min(self.threads, config.NUMBA_NUM_THREADS))
            cloud = api.reconstruct(self.load(), **self.options)
            cloud.save(self.output)
        return cloud.notes


def run(args: argparse.Namespace, options: dict) -> int:
    """Reconstruct the frames that are not in the folder yet; `options` are those of api.reconstruct."""
    from srt3d_ros.datasets import cloud_files, many_frames

    numbers = numbers_of(args.frames, args.input, args.photons_topic)
    jobs = len(os.sched_getaffinity(0)) if args.jobs is None else args.jobs
    require(jobs > 0, "--jobs", jobs, "1 or more")
    cloud_files.check_format(Path(f"0.{args.format}"))
    with executor(jobs, args.dask) as (pool, workers, threads):
        folder = folder_for(args)
        outputs, there = {k: folder / f"{k:06d}.{args.format}" for k in numbers}, set(os.listdir(folder))
        left = [number for number, output in outputs.items() if output.name not in there]
        loaders = many_frames.loaders(args.input, left, args.photons_topic, **common.overrides(args)) if left else ()
        tasks = (Task(number, load, options, outputs[number], threads) for number, load in loaders)
        errors = first_results(tasks)
        steps = progress(range(len(left) - len(errors)), "reconstructing")
        try:
            for _, (number, error) in zip(steps, results_of(tasks, pool, workers)):
                errors[number] = error
        except InvalidInput as error:       # a bag that breaks off, or a worker that died
            rest = [number for number in left if number not in errors]
            errors[f"{rest[0]} to {rest[-1]}"] = str(error)
    failed = {str(number): error for number, error in errors.items() if error}
    for number, error in failed.items():
        print(f"srt3d: frame {number}: {error}", file=sys.stderr)
    facts = {"frames": len(numbers), "reconstructed": len(errors) - len(failed), "there": len(numbers) - len(left),
             "failed": failed, "output": str(args.output)}
    words = "{reconstructed:,} of {frames:,} frames reconstructed, {there:,} were there\n{output}"
    common.print_facts(args, facts, words.format(**facts))
    return FAILED if failed else 0


def numbers_of(wanted: str, path: str, photons_topic: str) -> range:
    """The frames that `--frames` names; InvalidInput if there are none such."""
    from srt3d_ros.datasets.many_frames import count

    match, number = RANGE.fullmatch(wanted), count(path, photons_topic)
    require(match or wanted == "all", "--frames", wanted, "all, or first and last frame such as 0-99")
    require(match or number is not None, "--frames", wanted, f"first and last frame such as 0-99: {path} has no end")
    first, last = map(int, match.groups()) if match else (0, number - 1)
    fits = first <= last and (number is None or last < number)
    require(fits, "--frames", problem=f"{path} has no frames {first} to {last} (it has {number}).")
    return range(first, last + 1)


def folder_for(args: argparse.Namespace) -> Path:
    """The folder for the clouds, made if it is missing; InvalidInput if it has clouds of another input or options.

    OPTIONS_FILE keeps both.
    """
    folder = Path(args.output).absolute()
    check_not_input(folder, args.input)
    is_file = os.path.lexists(folder) and not folder.is_dir()
    require(not is_file, "output", problem=f"{args.output} is a file: with --frames, give a folder.")
    arguments = vars(args) | {"input": os.path.abspath(args.input)}
    text = json.dumps({name: value for name, value in arguments.items() if name not in OF_THE_RUN}, indent=1)
    with file_errors("output", args.output):
        folder.mkdir(exist_ok=True)
        path = folder / OPTIONS_FILE
        if any(map(CLOUD_FILE.match, os.listdir(folder))):
            same = path.exists() and path.read_bytes() == text.encode()
            require(same, "output", problem=f"{args.output} has clouds of another input or of other options (see "
                    f"{OPTIONS_FILE} there): give another folder.")
        with atomic_write(path) as part:
            part.write_text(text, encoding="utf-8")
    return folder


@contextmanager
def executor(jobs: int, address: str) -> Iterator[tuple[Executor, int, int]]:
    """An executor on this machine or a cluster, the number of its processes, and the threads of each."""
    if not address:
        with ProcessPoolExecutor(jobs, get_context("spawn"), signal.signal, (signal.SIGINT, signal.SIG_DFL)) as pool:
            yield pool, jobs, max(len(os.sched_getaffinity(0)) // jobs, 1)
        return
    from distributed import Client

    require(ADDRESS.fullmatch(address), "--dask", address, "the address of a scheduler such as tcp://HOST:8786")
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except OSError as error:      # also of a wrong host, and no answer in time
        raise InvalidInput("--dask", problem=f"No scheduler answers at {address} ({error}).") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECT_S)
        except TimeoutError:
            raise InvalidInput("--dask", problem=f"The scheduler at {address} has no workers.") from None
        threads = client.nthreads().values()
        yield client.get_executor(pure=False), len(threads), max(threads)


def first_results(tasks: Iterator[Task]) -> dict[int, str]:
    """Do frames here until one succeeds, at most two: kernels are compiled once. By number, what is wrong, or "".

    Raises:
        InvalidInput: the same is wrong with both frames: an option, that is.
    """
    errors = {}
    for task in islice(tasks, 2):
        try:
            common.print_notes(task())
        except InvalidInput as error:
            require(str(error) not in errors.values(), error.field, problem=str(error))
            errors[task.number] = str(error)
        else:
            return errors | {task.number: ""}
    return errors


def results_of(tasks: Iterator[Task], pool: Executor, workers: int) -> Iterator[tuple[int, str]]:
    """Yield the number of each frame as it is done, and what is wrong, or "". Few frames are read ahead.

    Raises:
        InvalidInput: the tasks end in it, or a worker process has died.
    """
    waiting, ended = {}, None
    while True:
        try:
            for task in islice(tasks, AHEAD * workers - len(waiting)):
                waiting[pool.submit(task)] = task.number
        except InvalidInput as error:
            ended = error
        if not waiting:
            break
        for future in concurrent.futures.wait(waiting, return_when=concurrent.futures.FIRST_COMPLETED).done:
            yield waiting.pop(future), error_of(future)
    if ended:
        raise ended


def error_of(future: Future) -> str:
    """What is wrong with a frame, in a line, or ""; InvalidInput if its process or the cluster is gone."""
    try:
        error = future.exception()
    except CancelledError as cancelled:
        error = cancelled
    gone = isinstance(error, BrokenExecutor | CancelledError)
    require(not gone, "--jobs", problem="A process has died, or the cluster has gone, for lack of memory perhaps. Give "
            "the command again, with fewer --jobs: it goes on where it stopped.")
    known = error is None or isinstance(error, InvalidInput)
    return str(error or "") if known else printable(f"{type(error).__name__}: {error}")
