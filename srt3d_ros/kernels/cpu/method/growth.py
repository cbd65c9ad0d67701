"""What birth/death should not have made: growth that no photons show, and ghosts. `kernels.torch` says why.

Growth: a pixel is new if birth/death has given it its first surface. Its v, n and g r are summed over the new pixels
within NEW_RADIUS (a square). Its points go if the log-likelihood ratios of its own v, n, g r and of these sums are both
below 0. A pixel with points that stay within HOLE pixels on HOLE_SIDES of its sides keeps its own: it is a hole.

Ghosts: a surface goes if r_k Π_j ‖u(t_k − t_j)‖ < WRONG_SHAPE · min(Σ_j r_j, n / g), j: the pixel's stronger
surfaces. `frame.unlike` has ‖u‖ by the bin of the distance.
"""

import numpy as np
from numba import boolean, get_thread_id, prange

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.constants import HOLE, NEW_RADIUS
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, ONE, TWO, ZERO
from srt3d_ros.kernels.cpu.compiling import floats2d, floats3d, floats4d, line, parallel
from srt3d_ros.kernels.cpu.method.frame import Frame, columns
from srt3d_ros.kernels.cpu.method.likelihood import EXPECTED, LIKENESS, PHOTONS, RESPONSE, by_bin, llr, write_shown
from srt3d_ros.kernels.cpu.vectors import full, lanes_of, load, store, where
from srt3d_ros.kernels.maps import DEPTH, FIELDS, INTENSITY, LANES, MARGIN, TERMS

EMPTY, SHOWN, REFUSED = ZERO, ONE, TWO      # values of `mark`
HOLE_SIDES = F32(constants.HOLE_SIDES)
WRONG_SHAPE = F32(constants.WRONG_SHAPE)


@line
def _has_points(i, j, state):
    there = full(False)
    for k in range(state.shape[1]):
        there |= load(state, i, k, INTENSITY, j) > ZERO
    return there


@parallel
def _note(state: floats4d, had: floats2d):
    for i in prange(len(state)):
        for j in range(0, state.shape[3], LANES):
            store(had, i, j, where(_has_points(i, j, state), ONE, ZERO))


@line
def _find_new(i, state, terms, had, fresh, mark):
    """Write v, n and g r of the new pixels of a row, 0 elsewhere, and its marks; whether there are new ones."""
    found = False
    for j in columns(state):
        there = _has_points(i, j, state)
        is_new = there & (load(had, i, j) == ZERO)
        write_shown(is_new, i, j, state, terms, fresh)
        store(mark, i, 0, j, where(there, SHOWN, EMPTY))
        found |= lanes_of(is_new) > 0
    return found


@line
def _judge_row(i, frame, fresh, sums, mark):
    """Mark the new pixels of a row that nothing shows as REFUSED; whether there are any."""
    refused = False
    for j in range(0, fresh.shape[2], LANES):
        for c in range(EXPECTED + 1):
            total = full(ZERO)
            for a in range(i - NEW_RADIUS, i + NEW_RADIUS + 1):
                total += load(fresh, a, c, j)
            store(sums, c, j, total)
    for j in columns(fresh):
        response, photons, expected = load(fresh, i, RESPONSE, j), load(fresh, i, PHOTONS, j), load(
            fresh, i, EXPECTED, j)
        unlikely = (expected > ZERO) & (llr(response, photons, expected, LIKENESS, frame) < ZERO)
        if lanes_of(unlikely):
            response, photons, expected = full(ZERO), full(ZERO), full(ZERO)
            for b in range(j - NEW_RADIUS, j + NEW_RADIUS + 1):
                response += load(sums, RESPONSE, b)
                photons += load(sums, PHOTONS, b)
                expected += load(sums, EXPECTED, b)
            unlikely &= llr(response, photons, expected, LIKENESS, frame) < ZERO
            store(mark, i, 0, j, where(unlikely, REFUSED, load(mark, i, 0, j)))
            refused |= lanes_of(unlikely) > 0
    return refused


@line
def _remove_row(i, mark, state, terms):
    """Remove the points of refused pixels that are no holes."""
    for j in columns(state):
        goes = load(mark, i, 0, j) == REFUSED
        if lanes_of(goes):
            sides = full(ZERO)
            for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1)):
                shown = full(False)
                for distance in range(1, HOLE + 1):
                    shown |= load(mark, i + distance * down, 0, j + distance * right) == SHOWN
                sides += where(shown, ONE, ZERO)
            goes &= sides < HOLE_SIDES
            for k in range(state.shape[1]):
                store(state, i, k, INTENSITY, j, where(goes, ZERO, load(state, i, k, INTENSITY, j)))
                for f in range(TERMS):
                    store(terms, i, k, f, j, where(goes, ZERO, load(terms, i, k, f, j)))


@parallel
def _refuse(frame: Frame, state: floats4d, terms: floats4d, had: floats2d,
            fresh: floats3d, mark: floats3d, sums: floats3d, found: boolean[::1]):
    for i in prange(MARGIN, len(state) - MARGIN):
        found[i] = _find_new(i, state, terms, had, fresh, mark)
    if found.any():
        for i in prange(MARGIN, len(state) - MARGIN):
            found[i] = found[i] and _judge_row(i, frame, fresh, sums[get_thread_id()], mark)
        for i in prange(MARGIN, len(state) - MARGIN):
            if found[i]:
                _remove_row(i, mark, state, terms)


def note_surfaces(work, state):
    """Remember which pixels have points, for `refuse_growth`."""
    _note(state, work.had)


def refuse_growth(work, frame, state, terms):
    """Remove the points that the change since `note_surfaces` should not have made, and their terms, in place."""
    found = np.zeros(len(state), np.bool_)
    _refuse(frame, state, terms, work.had, work.rim, work.blank, work.means, found)


@line
def _judge_surfaces(i, frame, state, kept, stale):
    """Write the intensities of a row's points, 0 for ghosts, and which vectors have any."""
    for j in columns(state):
        further = full(False)
        for k in range(1, state.shape[1]):
            further |= load(state, i, k, INTENSITY, j) > ZERO
        stale[i, j // LANES] = False
        if lanes_of(further) == 0:
            continue
        light = load(frame.counts, i, j) / max(load(frame.exposure, i, j), EPSILON)
        for k in range(state.shape[1]):
            own, depth = load(state, i, k, INTENSITY, j), load(state, i, k, DEPTH, j)
            stronger, shown = full(ZERO), own
            for o in range(state.shape[1]):
                if o != k:
                    other = load(state, i, o, INTENSITY, j)
                    is_stronger = (other > own) | ((other == own) & (o < k))
                    is_stronger &= other > ZERO
                    stronger += where(is_stronger, other, ZERO)
                    shown *= where(is_stronger, by_bin(frame.unlike, depth - load(state, i, o, DEPTH, j)), ONE)
            ghost = (own > ZERO) & (shown < WRONG_SHAPE * min(stronger, light))
            stale[i, j // LANES] |= lanes_of(ghost) > 0
            store(kept, i, k, j, where(ghost, ZERO, own))


@line
def _move_up(i, kept, stale, state):
    """Take the intensities that are kept, and move surfaces down into gaps."""
    for j in columns(state):
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
def _drop_ghosts(frame: Frame, state: floats4d, kept: floats3d, stale: boolean[:, ::1]):
    for i in prange(MARGIN, len(state) - MARGIN):
        _judge_surfaces(i, frame, state, kept, stale)
        _move_up(i, kept, stale, state)


def drop_ghosts(work, frame, state):
    """`work.stale` says which vectors of pixels have lost some."""
    if state.shape[1] > 1:
        _drop_ghosts(Frame.of(frame), state, work.ratios, work.stale)
