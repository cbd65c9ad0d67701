"""The kernels on the CPU (`kernels.contract`), in numba: for NumPy arrays, compiled at first use, cached on disk.

Rows run in parallel; within a row, LANES neighbouring columns are one vector (`vectors`, `spans`). The time for a frame
does not depend on its photons, and results do not depend on the number of threads: no sum runs across threads. Results
of a kernel `for_shape` are valid until the next frame. A kernel is a body for one vector of pixels, and a function
that gives it memory:

    @each                                                           # of `compiling`
    def _brighten(i, j, frame: Frame, gain: float32, state: floats4d):
        for k in range(state.shape[1]):
            r = state[i, k, INTENSITY, j]                           # of LANES pixels: row i, columns j
            state[i, k, INTENSITY, j] = where(frame.exposure[i, j] > 0, gain * r, 0)

    def brighten(work, frame, state, gain):
        _brighten(frame, F32(gain), state)

`each` makes of it, and compiles for the types that the arguments are annotated with:

    def _brighten(frame, gain, state):
        for i in prange(MARGIN, len(state) - MARGIN):               # rows of the last argument
            for j in columns(state):                                # in a function of its own
                body(i, j, frame, gain, state)

With several bodies, each gets such a loop, one after the other.
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
IN_A_WORKSPACE = (background, birth_death, drop_blobs, drop_ghosts, expand, finalise, local_mean, log_likelihood_ratio,
                  no_surfaces, pooled_step, prepare, residual, search, solve_pairs, trim, turn_planes, unexplained)
ANYWHERE = (apss, array, as_frame, blur, collect, drop_weak, match, median_depth, numpy, pixelwise, unpack,
            usual_intensity)


def for_shape(rows: int, cols: int, surfaces: int, frequencies: tuple[int, ...]) -> SimpleNamespace:
    """The kernels with memory of their own for frames of one shape, for one thread at a time."""
    work = Workspace(rows, cols, surfaces, frequencies)
    return SimpleNamespace(work=work, **{kernel.__name__: kernel for kernel in ANYWHERE},
                           **{kernel.__name__: partial(kernel, work) for kernel in IN_A_WORKSPACE})
