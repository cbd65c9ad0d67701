"""The CUDA kernels, in Triton: `kernels.api` on tensors of the device.

Compiled at first use, cached on disk. They read and write device memory only and never wait for it: once compiled, a
sequence of them can be captured in a CUDA graph. One program works on BLOCK neighbouring columns of one row, like the
inner loops of the CPU kernels; what it adds up stays in registers.
"""

from srt3d_ros.kernels.cuda.apss import apss
from srt3d_ros.kernels.cuda.birth_death import birth_death
from srt3d_ros.kernels.cuda.blur import blur
from srt3d_ros.kernels.cuda.device import ON_HOST, Scratch, array, numpy, photon_array
from srt3d_ros.kernels.cuda.finalise import collect, finalise, unpack
from srt3d_ros.kernels.cuda.frame_stream import WARM_FRAMES, FrameStream
from srt3d_ros.kernels.cuda.gradients import pixelwise, poisson
from srt3d_ros.kernels.cuda.likelihood import log_likelihood_ratio
from srt3d_ros.kernels.cuda.match import match
from srt3d_ros.kernels.cuda.move_sketch import move_sketch, read_moved
from srt3d_ros.kernels.cuda.phase_sums import (
    counted,
    find_stray,
    fixed_rows,
    inspect_events,
    new_sums,
    read_sums,
    sketch_continuous,
    sketch_gates,
    sketch_histograms,
    sketch_sorted,
    sketch_unsorted,
)
from srt3d_ros.kernels.cuda.pooled_step import expand, pooled_step
from srt3d_ros.kernels.cuda.prepare import prepare, residual
from srt3d_ros.kernels.cuda.search import drop_weak, search
from srt3d_ros.kernels.cuda.trim import trim
from srt3d_ros.kernels.cuda.unexplained import unexplained

__all__ = ["ON_HOST", "FrameStream", "Scratch", "WARM_FRAMES", "apss", "array", "birth_death", "blur", "collect",
           "counted", "drop_weak", "expand", "finalise", "find_stray", "fixed_rows", "inspect_events",
           "log_likelihood_ratio", "match", "move_sketch", "new_sums", "numpy", "photon_array", "pixelwise", "poisson",
           "pooled_step", "prepare", "read_moved", "read_sums", "residual", "search", "sketch_continuous",
           "sketch_gates", "sketch_histograms", "sketch_sorted", "sketch_unsorted", "trim", "unexplained", "unpack"]
