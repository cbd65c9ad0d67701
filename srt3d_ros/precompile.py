"""Compiles the CPU kernels, or loads them from the disk, ahead of the first frame."""

import os
import signal
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context

from srt3d_ros.core.sensor.model import MAX_BINS, SensorModel
from srt3d_ros.kernels.devices import kernels_for

ANY_SENSOR = SensorModel(rows=1, cols=2, num_bins=MAX_BINS, bin_width_s=1e-9, irf=[1.0])
LONGEST = ("search._search_row", "birth_death._decide", "pooled_step._step",
           "move_sketch._find_targets")    # begun first, they end with the rest
PROCESS_BYTES = 2**29       # memory of a process that compiles


def names() -> list[str]:
    """The kernels of sketching, deskewing and the default method, slowest to compile first."""
    kernels = kernels_for("cpu")
    needed = (name for name in kernels.KERNELS if name.partition(".")[0] not in kernels.OTHER_METHODS)
    return list(dict.fromkeys([*LONGEST, *needed]))


def everything() -> None:
    """Compile all of `names`, one process a core, in at most half of the memory."""
    from tqdm import tqdm  # here: slow

    room = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2 // PROCESS_BYTES
    processes = max(min(len(os.sched_getaffinity(0)), room), 1)
    with ProcessPoolExecutor(processes, get_context("spawn"), signal.signal, (signal.SIGINT, signal.SIG_DFL)) as pool:
        compiled = [pool.submit(_compile, name) for name in names()]
        for one in tqdm(as_completed(compiled), "compiling", len(compiled), disable=None, leave=False):
            one.result()


def _compile(name: str) -> None:
    kernels_for("cpu").KERNELS[name].compile()
