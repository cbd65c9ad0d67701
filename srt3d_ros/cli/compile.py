"""`srt3d compile`: compile the CPU kernels before they are needed, so that the first start is as fast as any other."""

import time

from srt3d_ros.errors import require


def add_parser(subparsers) -> None:
    parser = subparsers.add_parser(
        "compile", help="compile the CPU kernels of the default method ahead of the first start",
        description="For this user and processor. Kernels of other methods are compiled at their first use.")
    parser.set_defaults(run=run)


def run(_) -> int:
    from srt3d_ros.core import precompile
    from srt3d_ros.kernels.cpu.compiling import FOLDER, WHY_NONE

    require(FOLDER is not None, *WHY_NONE, "a folder for kernels that only you may write to; NUMBA_CACHE_DIR names "
            "another")
    started, before = time.perf_counter(), set(FOLDER.rglob("*.nbc"))
    precompile.everything()
    new = set(FOLDER.rglob("*.nbc")) - before
    print(f"compiled {len(new)} kernels in {time.perf_counter() - started:.0f} s; they are in {FOLDER}")
    return 0
