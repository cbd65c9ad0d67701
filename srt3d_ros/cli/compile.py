"""`srt3d compile`: compile the CPU kernels before they are needed, so that the first start is as fast as any other."""

import argparse
import subprocess
import sys
import time

# The child finds the same packages, whatever the working directory, and ends at Ctrl-C without a traceback.
CHILD = """import signal, sys
signal.signal(signal.SIGINT, signal.SIG_DFL)
sys.path[:] = {path}
from srt3d_ros.core import precompile
precompile.{step}()"""


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "compile", help="compile the CPU kernels ahead of the first start",
        description="Compile the CPU kernels of the default method, for this user and processor, in two processes. "
                    "Others are compiled at their first use. Again after an update of srt3d_ros, numba or Python.")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from srt3d_ros.kernels.cpu.compiling import FOLDER

    if FOLDER is None:
        print("srt3d: error: ~/.cache cannot be written: set NUMBA_CACHE_DIR", file=sys.stderr)
        return 1
    started, before = time.perf_counter(), set(FOLDER.rglob("*.nbc"))
    children = [subprocess.Popen([sys.executable, "-c", CHILD.format(path=sys.path, step=step)])
                for step in ("reconstruction", "birth_death_and_sketching")]
    if any([child.wait() for child in children]):
        print("srt3d: error: a process that compiles died (too little memory?)", file=sys.stderr)
        return 1
    compiled = len(set(FOLDER.rglob("*.nbc")) - before)
    print(f"compiled {compiled} kernels in {time.perf_counter() - started:.0f} s; they are in {FOLDER}")
    return 0
