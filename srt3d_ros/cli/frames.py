"""`srt3d reconstruct --frames`: each frame into a file of its own, on this machine's cores or on a Dask cluster."""

import argparse
import concurrent.futures
import json
import logging
import os
import re
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from threading import Lock

from srt3d_ros.cli import common
from srt3d_ros.errors import InvalidInput, printable, require
from srt3d_ros.files.new_files import atomic_write, check_not_input, file_errors
from srt3d_ros.progress import progress

CONNECT_S = 10          # until a scheduler answers, and until it has a worker
AHEAD = 2               # frames read for each worker, so that none waits for the next one
OPTIONS_FILE = "options.json"
OF_THE_RUN = ("output", "frame", "frames", "format", "jobs", "dask", "json", "run")     # arguments that change no cloud
FAILED = 1
ONE_AT_A_TIME = Lock()      # a worker of Dask may have several threads, but a frame uses them all
GONE = "A worker ended, possibly out of memory. Run again with fewer --jobs to resume."


def run(args: argparse.Namespace, options: dict) -> int:
    """Reconstruct the frames that are not in the folder yet; `options` are those of api.reconstruct."""
    from srt3d_ros import datasets
    from srt3d_ros.datasets import cloud_files

    numbers = datasets.frame_numbers(args.input, args.frames, args.photons_topic)
    require(args.frame == 0, "--frame", args.frame, "none beside --frames")
    require(args.jobs is None or args.jobs > 0, "--jobs", args.jobs, "1 or more")
    cloud_files.check_format(Path(f"0.{args.format}"))
    errors = {}         # by number, "" of a frame that succeeded
    with executor(args.jobs, args.dask) as (pool, processes, threads):
        folder = folder_for(args)
        there = set(os.listdir(folder))
        name_of = f"{{:06d}}.{args.format}".format
        left = [number for number in numbers if name_of(number) not in there]
        loaders = datasets.frame_loaders(args.input, left, args.photons_topic, **common.overrides(args)) if left else ()
        tasks = ((number, partial(reconstruct, load, options, folder / name_of(number), threads))
                 for number, load in loaders)
        steps = progress(range(len(left)), "reconstructing")
        try:
            for _, (number, error) in zip(steps, results(tasks, pool, processes)):
                errors[number] = error
        except InvalidInput as error:       # a bag that breaks off, or a worker that died
            if "" not in errors.values():
                raise
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


def reconstruct(load: Callable, options: dict, output: Path, threads: int) -> tuple[str, ...]:
    """Write the cloud of the frame that `load` reads; returns its notes."""
    from numba import config, set_num_threads

    from srt3d_ros import api

    with ONE_AT_A_TIME:
        set_num_threads(min(threads, config.NUMBA_NUM_THREADS))
        cloud = api.reconstruct(load(), **options)
        cloud.save(output)
    return cloud.notes


def folder_for(args: argparse.Namespace) -> Path:
    """The folder for the clouds, made if it is missing; InvalidInput if it has clouds of another input or options.

    OPTIONS_FILE keeps both.
    """
    folder = Path(args.output).absolute()
    check_not_input(folder, args.input)
    require(folder.is_dir() or not os.path.lexists(folder), "output",
            problem=f"{args.output} is a file: with --frames, give a folder.")
    arguments = vars(args) | {"input": os.path.abspath(args.input)}
    text = json.dumps({name: value for name, value in arguments.items() if name not in OF_THE_RUN}, indent=1)
    with file_errors("output", args.output):
        folder.mkdir(exist_ok=True)
        path = folder / OPTIONS_FILE
        if any(re.match(r"\d{6,}\.", name) for name in os.listdir(folder)):
            same = path.exists() and path.read_bytes() == text.encode()
            require(same, "output", problem=f"{args.output} has clouds of another input or of other options (see "
                    f"{OPTIONS_FILE} there): give another folder.")
        with atomic_write(path) as part:
            part.write_text(text, encoding="utf-8")
    return folder


@contextmanager
def executor(jobs: int | None, address: str) -> Iterator[tuple[Executor, int, int]]:
    """An executor on this machine or a cluster, the number of its processes, and the threads of each."""
    if not address:
        cores = len(os.sched_getaffinity(0))
        jobs = jobs or cores
        with ProcessPoolExecutor(jobs, get_context("spawn"), signal.signal, (signal.SIGINT, signal.SIG_DFL)) as pool:
            yield pool, jobs, max(cores // jobs, 1)
        return
    from distributed import Client

    expected = "the address of a scheduler such as tcp://HOST:8786"
    require(re.fullmatch(r"\w+://.+:\d+", address), "--dask", address, expected)
    for logger in ("distributed.client", "tornado.application"):        # they log tracebacks of a cluster that is gone
        logging.getLogger(logger).disabled = True
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (ValueError, ImportError):       # of tcp:// and others
        raise InvalidInput("--dask", address, expected) from None
    except OSError as error:                # also of a wrong host, and no answer in time
        raise InvalidInput("--dask", problem=f"No scheduler answers at {address} ({error}).") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECT_S)
        except TimeoutError:
            raise InvalidInput("--dask", problem=f"The scheduler at {address} has no workers.") from None
        threads = client.nthreads().values()
        yield client.get_executor(pure=False), len(threads), max(threads)


def results(tasks: Iterator[tuple[int, Callable]], pool: Executor, processes: int) -> Iterator[tuple[int, str]]:
    """Do numbered tasks; yield the number of each that is done, and what is wrong, or "". Few frames are read ahead.

    Raises:
        InvalidInput: the same is wrong with the first two (an option, that is), the tasks end in it, or a process died.
    """
    first = ""
    for number, task in islice(tasks, 2):       # here until one succeeds: kernels are compiled once
        try:
            common.print_notes(task())
        except InvalidInput as error:
            if str(error) == first:
                raise
            first = str(error)
            yield number, first
        else:
            yield number, ""
            break
    waiting, ended = {}, None
    while True:
        try:
            for number, task in islice(tasks, AHEAD * processes - len(waiting)):
                waiting[pool.submit(task)] = number
        except (InvalidInput, BrokenExecutor) as error:
            ended = error if isinstance(error, InvalidInput) else InvalidInput("--jobs", problem=GONE)
        if not waiting:
            break
        for future in concurrent.futures.wait(waiting, return_when="FIRST_COMPLETED").done:
            yield waiting.pop(future), error_of(future)
    if ended:
        raise ended


def error_of(future: Future) -> str:
    """What is wrong with a frame, in a line, or ""; InvalidInput if its process or the cluster is gone."""
    try:
        future.result()
    except (BrokenExecutor, CancelledError):
        raise InvalidInput("--jobs", problem=GONE) from None
    except InvalidInput as error:
        return str(error)
    except Exception as error:
        return printable(f"{type(error).__name__}: {error}")
    return ""
