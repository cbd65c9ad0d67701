"""Remove ghosts: further surfaces of a pixel that are what a wrong impulse response leaves of stronger ones.

A surface goes if r_k Π_j ‖u(t_k − t_j)‖ < WRONG_SHAPE · min(Σ_j r_j, (√n + HALO)² / g) over the pixel's stronger
surfaces j; `unlike` has ‖u‖ by the bin of the distance. `kernels.torch` says why.
"""

from numba import boolean, float32, prange

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, ONE, ZERO
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.cpu.vectors import floor, full, gather, lanes_of, load, rint, sqrt, store, to_cell, where
from srt3d_ros.kernels.maps import DEPTH, FIELDS, INTENSITY, LANES, MARGIN

WRONG_SHAPE, HALO = F32(constants.WRONG_SHAPE), F32(constants.HALO)


@inline
def _unlike(distance, table):
    """‖u‖ at distances in bins."""
    bins, bin = F32(len(table)), rint(distance)
    return gather(table, to_cell(bin - bins * floor(bin / bins), bins - ONE))


@line
def _judge_row(i, frame, state, kept, stale):
    """Write the intensities of a row's points, 0 for ghosts, and which vectors have any."""
    for j in range(MARGIN, state.shape[3] - MARGIN, LANES):
        further = full(False)
        for k in range(1, state.shape[1]):
            further |= load(state, i, k, INTENSITY, j) > ZERO
        stale[i, j // LANES] = False
        if lanes_of(further) == 0:
            continue
        light = sqrt(load(frame.counts, i, j)) + HALO
        most = light * light / max(load(frame.exposure, i, j), EPSILON)
        for k in range(state.shape[1]):
            own, depth = load(state, i, k, INTENSITY, j), load(state, i, k, DEPTH, j)
            stronger, shown = full(ZERO), own
            for o in range(state.shape[1]):
                if o != k:
                    other = load(state, i, o, INTENSITY, j)
                    is_stronger = (other > own) | ((other == own) & (o < k))
                    is_stronger &= other > ZERO
                    stronger += where(is_stronger, other, ZERO)
                    shown *= where(is_stronger, _unlike(depth - load(state, i, o, DEPTH, j), frame.unlike), ONE)
            ghost = (own > ZERO) & (shown < WRONG_SHAPE * min(stronger, most))
            stale[i, j // LANES] |= lanes_of(ghost) > 0
            store(kept, i, k, j, where(ghost, ZERO, own))

@line
def _remove_row(i, kept, stale, state):
    """Take the intensities that are kept, and move surfaces down into gaps."""
    for j in range(MARGIN, state.shape[3] - MARGIN, LANES):
        if not stale[i, j // LANES]:
            continue
        for k in range(state.shape[1]):
            store(state, i, k, INTENSITY, j, load(kept, i, k, j))
        for last in range(state.shape[1] - 1, 0, -1):
            for k in range(last):
                gap = (load(state, i, k, INTENSITY, j) <= ZERO) & (load(state, i, k + 1, INTENSITY, j) > ZERO)
                if lanes_of(gap) != 0:
                    for f in range(FIELDS):
                        low, high = load(state, i, k, f, j), load(state, i, k + 1, f, j)
                        store(state, i, k, f, j, where(gap, high, low))
                        store(state, i, k + 1, f, j, where(gap, low, high))


@parallel
def _drop_ghosts(frame: Frame, state: float32[:, :, :, ::1], kept: float32[:, :, ::1], stale: boolean[:, ::1]):
    for turn in prange(len(state) - 2 * MARGIN):
        _judge_row(turn + MARGIN, frame, state, kept, stale)
        _remove_row(turn + MARGIN, kept, stale, state)


def drop_ghosts(work, frame, state):
    """`work.stale` says which vectors of pixels have lost some."""
    if state.shape[1] > 1:
        _drop_ghosts(Frame.of(frame), state, work.ratios, work.stale)
