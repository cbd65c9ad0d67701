"""The kernels on the CPU (`kernels.contract`), in numba: for NumPy arrays, compiled at first use, cached on disk.

Rows run in parallel; within a row, LANES neighbouring columns are one vector (`vectors`). The time for a frame does not
depend on its photons, and results do not depend on the number of threads: no sum runs across threads. Results of a
kernel `for_shape` are valid until the next frame.
"""

from functools import partial
from types import SimpleNamespace

from srt3d_ros.kernels.cpu.baselines.apss import apss
from srt3d_ros.kernels.cpu.baselines.gradients import blur, median_depth, pixelwise, poisson, usual_intensity
from srt3d_ros.kernels.cpu.compiling import KERNELS
from srt3d_ros.kernels.cpu.device import array, as_frame, numpy, unpack
from srt3d_ros.kernels.cpu.method.birth_death import birth_death
from srt3d_ros.kernels.cpu.method.collect import collect
from srt3d_ros.kernels.cpu.method.drops import drop_blobs, drop_ghosts, trim
from srt3d_ros.kernels.cpu.method.finalise import background, drop_weak, finalise, local_mean
from srt3d_ros.kernels.cpu.method.likelihood import log_likelihood_ratio
from srt3d_ros.kernels.cpu.method.match import match
from srt3d_ros.kernels.cpu.method.planes import turn_planes
from srt3d_ros.kernels.cpu.method.pooled_step import pooled_step
from srt3d_ros.kernels.cpu.method.search import no_surfaces, search
from srt3d_ros.kernels.cpu.method.sketches import expand, prepare, residual, solve_pairs, unexplained
from srt3d_ros.kernels.cpu.sketching.move_sketch import Motion, SeenScene, move_sketches
from srt3d_ros.kernels.cpu.sketching.phase_sums import (
    fixed_rows,
    new_sums,
    read_sums,
    sketch_events,
    sketch_gates,
    sketch_histograms,
)
from srt3d_ros.kernels.cpu.sketching.seen_ranges import seen_ranges
from srt3d_ros.kernels.cpu.workspace import Workspace
from srt3d_ros.kernels.maps import UNIT

OTHER_METHODS = "apss", "gradients", "match"        # modules whose kernels no frame of the default method needs
IN_A_WORKSPACE = (birth_death, drop_blobs, drop_ghosts, expand, finalise, log_likelihood_ratio, no_surfaces,
                  pooled_step, prepare, residual, search, solve_pairs, trim, turn_planes, unexplained)
ANYWHERE = (apss, array, as_frame, background, blur, collect, drop_weak, local_mean, match, median_depth, numpy,
            pixelwise, unpack, usual_intensity)


def for_shape(rows: int, cols: int, surfaces: int, frequencies: tuple[int, ...]) -> SimpleNamespace:
    """The kernels with memory of their own for frames of one shape, for one thread at a time."""
    work = Workspace(rows, cols, surfaces, frequencies)
    return SimpleNamespace(work=work, **{each.__name__: each for each in ANYWHERE},
                           **{each.__name__: partial(each, work) for each in IN_A_WORKSPACE})
