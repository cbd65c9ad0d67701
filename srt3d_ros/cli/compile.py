"""`srt3d compile`: compile the CPU kernels before they are needed, so that the first start is as fast as any other."""

import argparse
import os
import sys
import time
from concurrent.futures import wait
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path

import srt3d_ros

ABOUT = """\
Compile the CPU kernels of the srt3d_ros that this command belongs to, for this processor, in two processes. Without it
the first start of a node compiles what it needs. Again after an update of srt3d_ros, numba or Python; for each user
who cannot write to the folder where srt3d_ros is installed. Graphics cards need none of this."""
STAMP = "compiled_ahead"    # file beside the machine code: for what all of it has been compiled
ALL, DEFAULT = "all", "default method"
PACKAGE = Path(srt3d_ros.__file__).parent
PROGRESS_S = 0.5
FAILED = 1


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser("compile", help="compile the CPU kernels ahead of the first start",
                                   description=ABOUT)
    parser.add_argument("--all", action="store_true", help="also those of the methods that are not the default")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from srt3d_ros.kernels.cpu import compiling

    started, folder = time.perf_counter(), compiling.folder()
    where = _where(folder, compiling.CANNOT_KEEP)
    missing = compiling.missing(args.all)
    state = compiling.state_of(compiling.KERNELS[0])
    if not missing and _stamp(folder) in {f"{state} {ALL}", f"{state} {ALL if args.all else DEFAULT}"}:
        print(f"already compiled: the CPU kernels of {PACKAGE} are {where}")
        return 0
    print(f"compiling the CPU kernels of {PACKAGE}", flush=True)
    try:
        compiled = _compile(args.all, missing)
    except BrokenProcessPool:
        print("srt3d: error: a process that compiles died (too little memory?)", file=sys.stderr)
        return FAILED
    seconds = time.perf_counter() - started
    if folder:
        (folder / STAMP).write_text(f"{state} {ALL if args.all else DEFAULT}")
    what = f"compiled {len(compiled)} kernels" if compiled else "found all kernels compiled"
    print(f"{what} in {seconds:.0f} s; they are {where}")
    return 0


def _stamp(folder: Path | None) -> str:
    """For what this command has compiled; the machine code alone may lack some types of arguments."""
    try:
        return (folder / STAMP).read_text() if folder else ""
    except OSError:
        return ""


def _where(folder: Path | None, why_not: str) -> str:
    if folder is None:
        return f"kept nowhere, so every start compiles them: {why_not}"
    if PACKAGE in folder.parents:
        return f"in {folder}"
    why = "as NUMBA_CACHE_DIR says" if "NUMBA_CACHE_DIR" in os.environ else "for this user: the package is read-only"
    return f"in {folder}, {why}"


def _compile(also_baselines: bool, missing: list) -> set[str]:
    """Compile in two processes; returns the names of the kernels that were compiled."""
    from tqdm import tqdm

    from srt3d_ros.batch.executors import LocalProcesses
    from srt3d_ros.core.precompile import BASELINES, PARTS
    from srt3d_ros.kernels.cpu import compiling

    processes = LocalProcesses(len(PARTS), print)
    try:
        steps = [[step.__name__ for step in part if also_baselines or step not in BASELINES] for part in PARTS]
        parts = [processes.submit(partial(_compile_part, names)) for names in steps]
        with tqdm(total=len(missing), unit="kernel", disable=None, leave=False) as bar:
            while wait(parts, PROGRESS_S).not_done:
                bar.update(len(missing) - len(compiling.missing(also_baselines)) - bar.n)
        return set().union(*(part.result() for part in parts))
    finally:
        processes.close()


def _compile_part(steps: list[str]) -> set[str]:
    """In a process: compile; the names of the kernels that had to be."""
    from srt3d_ros.core import precompile
    from srt3d_ros.kernels.cpu import compiling

    names: set[str] = set()
    compiling.on_compiled(lambda kernel: names.add(compiling.name_of(kernel)))
    for step in steps:
        getattr(precompile, step)()
    return names
