"""The CUDA kernels, in Triton: the functions of `kernels/cpu` with the same arguments, on tensors of the device.

Compiled at first use, cached on disk. They read and write device memory only and never wait for it: once compiled, a
sequence of them can be captured in a CUDA graph. One program works on BLOCK neighbouring columns of one row, like the
inner loops of the CPU kernels; what it adds up stays in registers.
"""

from srt3d_ros.kernels.cuda.apss import apss
from srt3d_ros.kernels.cuda.blur import blur
from srt3d_ros.kernels.cuda.collect import collect, unpack
from srt3d_ros.kernels.cuda.descend import descend
from srt3d_ros.kernels.cuda.device import DEVICE, array, numpy
from srt3d_ros.kernels.cuda.evidence import evidence
from srt3d_ros.kernels.cuda.explain import explain, leave
from srt3d_ros.kernels.cuda.intensity import own_intensity
from srt3d_ros.kernels.cuda.match import match
from srt3d_ros.kernels.cuda.pipeline import Pipeline
from srt3d_ros.kernels.cuda.pixelwise import pixelwise
from srt3d_ros.kernels.cuda.poisson import poisson
from srt3d_ros.kernels.cuda.prepare import prepare
from srt3d_ros.kernels.cuda.propose import propose
from srt3d_ros.kernels.cuda.relief import relief
from srt3d_ros.kernels.cuda.scratch import Scratch
from srt3d_ros.kernels.cuda.search import drop_weak, search
from srt3d_ros.kernels.cuda.settle import settle
from srt3d_ros.kernels.cuda.sketch import (
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

__all__ = ["DEVICE", "Pipeline", "Scratch", "apss", "array", "blur", "collect", "descend", "drop_weak", "evidence",
           "explain", "find_stray", "fixed_rows", "inspect_events", "leave", "match", "new_sums", "numpy",
           "own_intensity", "pixelwise", "poisson", "prepare", "propose", "read_sums", "relief", "search", "settle",
           "sketch_continuous", "sketch_gates", "sketch_sorted", "sketch_unsorted", "unpack"]
