"""The CPU kernels, in numba: compiled at first use, cached on disk.

Rows run in parallel, and inside a row BLOCK neighbouring columns run in vector registers. The cost of a frame does not
depend on its photons, and results do not depend on the number of threads: no sum runs across threads
(`arithmetic.total_of`).
"""

from srt3d_ros.kernels.cpu.apss import apss
from srt3d_ros.kernels.cpu.blur import blur
from srt3d_ros.kernels.cpu.descend import descend
from srt3d_ros.kernels.cpu.evidence import evidence
from srt3d_ros.kernels.cpu.explain import explain, leave
from srt3d_ros.kernels.cpu.intensity import own_intensity
from srt3d_ros.kernels.cpu.match import match
from srt3d_ros.kernels.cpu.pixelwise import pixelwise
from srt3d_ros.kernels.cpu.poisson import poisson
from srt3d_ros.kernels.cpu.prepare import prepare
from srt3d_ros.kernels.cpu.propose import propose
from srt3d_ros.kernels.cpu.relief import relief
from srt3d_ros.kernels.cpu.scratch import Pipeline, Scratch, array, numpy
from srt3d_ros.kernels.cpu.search import drop_weak, search
from srt3d_ros.kernels.cpu.settle import collect, settle
from srt3d_ros.kernels.cpu.sketch import (
    find_stray,
    fixed_rows,
    inspect_events,
    new_sums,
    read_sums,
    sketch_continuous,
    sketch_gates,
    sketch_sorted,
    sketch_unsorted,
)

__all__ = ["Pipeline", "Scratch", "apss", "array", "blur", "collect", "descend", "drop_weak", "evidence", "explain",
           "find_stray", "fixed_rows", "inspect_events", "leave", "match", "new_sums", "numpy", "own_intensity",
           "pixelwise", "poisson", "prepare", "propose", "read_sums", "relief", "search", "settle",
           "sketch_continuous", "sketch_gates", "sketch_sorted", "sketch_unsorted"]
