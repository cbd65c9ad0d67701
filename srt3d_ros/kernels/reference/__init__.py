"""The executable specification of `kernels.api`: plain NumPy, written to be read, not to be fast.

All arithmetic is float64, so that another backend differs from it by its own rounding only. A pixel's statistics are
complex numbers z_l here; the maps hold their real parts before their imaginary ones.
"""

from srt3d_ros.kernels.reference.baselines import apss, pixelwise, poisson
from srt3d_ros.kernels.reference.birth_death import birth_death
from srt3d_ros.kernels.reference.device import ON_HOST, WARM_FRAMES, FrameStream, Scratch, array, numpy, photon_array
from srt3d_ros.kernels.reference.finalise import collect, finalise, unpack
from srt3d_ros.kernels.reference.likelihood import log_likelihood_ratio
from srt3d_ros.kernels.reference.move_sketch import move_sketch, read_moved
from srt3d_ros.kernels.reference.phase_sums import (
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
from srt3d_ros.kernels.reference.pooled_step import expand, pooled_step
from srt3d_ros.kernels.reference.search import blur, drop_weak, match, prepare, residual, search
from srt3d_ros.kernels.reference.trim import trim
from srt3d_ros.kernels.reference.unexplained import unexplained

__all__ = ["ON_HOST", "FrameStream", "Scratch", "WARM_FRAMES", "apss", "array", "birth_death", "blur", "collect",
           "counted", "drop_weak", "expand", "finalise", "find_stray", "fixed_rows", "inspect_events",
           "log_likelihood_ratio", "match", "move_sketch", "new_sums", "numpy", "photon_array", "pixelwise", "poisson",
           "pooled_step", "prepare", "read_moved", "read_sums", "residual", "search", "sketch_continuous",
           "sketch_gates", "sketch_histograms", "sketch_sorted", "sketch_unsorted", "trim", "unexplained", "unpack"]
