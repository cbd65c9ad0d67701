"""`srt3d compile`: compile kernels ahead, so that the first start is as fast as any other."""

import argparse
import time

from srt3d_ros.errors import require


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser("compile", description="Compile the CPU's kernels for this user and processor. "
                                   "Kernels of other methods than the default are compiled at their first use.")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from srt3d_ros import precompile
    from srt3d_ros.kernels.cpu.compiling import FOLDER, NOT_KEPT

    require(not NOT_KEPT, "NUMBA_CACHE_DIR", problem=f"Cannot keep kernels: {NOT_KEPT}. Set "
            "NUMBA_CACHE_DIR to a folder that only you can write to.")
    started, before = time.perf_counter(), set(FOLDER.rglob("*.nbc"))
    precompile.everything()
    new = set(FOLDER.rglob("*.nbc")) - before
    print(f"compiled {len(new)} kernels in {time.perf_counter() - started:.0f} s; they are in {FOLDER}")
    return 0
