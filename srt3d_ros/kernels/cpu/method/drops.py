"""What must go: growth that no photons show, ghosts, dim outlines, and blobs of chance. `kernels.torch` says why.

Growth: a pixel is new if birth/death has given it its first surface. Its v, n and g r are summed over the new pixels
within NEW_RADIUS (a square). Its points go if the log-likelihood ratios of its own v, n, g r and of these sums are both
below 0. A pixel with points that stay within HOLE pixels on HOLE_SIDES of its sides keeps its own: it is a hole.

Ghosts: a surface goes if r_k Π_j ‖u(t_k − t_j)‖ < WRONG_SHAPE · min(Σ_j r_j, n / g), j: the pixel's stronger
surfaces. `frame.unlike` has ‖u‖ by the bin of the distance.

Outlines: a pixel with a surface is at the rim if RIM of the 8 around are used (g > 0) and have none. Over the rim
within VOTE_RADIUS, V = Σ v, p = Σ n and μ = Σ g r are pooled. Its points go if √p ρ(V₊ / p) ≤ enough · c(t) and the
log-likelihood ratio of V, p and μ is below 0. That is done TRIMMED times, a pixel each.

Blobs: points go unless one with score / c(t) of `enough` is within the reach of the last window (a square).
"""

from math import ceil

import numpy as np
from numba import boolean, float32, prange

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.constants import HOLE, NEW_RADIUS, REACH, RIM, TRIMMED, VOTE_RADIUS, WINDOWS
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, ONE, ZERO
from srt3d_ros.kernels.cpu.compiling import each_row, floats2d, floats3d, floats4d, inline, line, parallel
from srt3d_ros.kernels.cpu.method.frame import Frame, columns, is_surface, point_at, terms_at
from srt3d_ros.kernels.cpu.method.likelihood import LIKENESS, by_bin, llr, noise_at, score_of
from srt3d_ros.kernels.cpu.vectors import full, lanes_of, load, store, where
from srt3d_ros.kernels.maps import DEPTH, FIELDS, INTENSITY, LANES, MARGIN, TERMS

HOLE_SIDES = F32(constants.HOLE_SIDES)
WRONG_SHAPE = F32(constants.WRONG_SHAPE)
BLOB_RADIUS = ceil(REACH * WINDOWS[-1].sigma)


@inline
def _around(values, i, c, j, radius):
    """The sums over the squares around pixels."""
    value = full(ZERO)
    for a in range(i - radius, i + radius + 1):
        for b in range(j - radius, j + radius + 1):
            value += load(values, a, c, b)
    return value


@inline
def _write_shown(which, i, j, state, terms, out):
    """Write v, n and g r of the points of those pixels (i, j …) that `which` selects, 0 elsewhere."""
    response, photons, expected = full(ZERO), full(ZERO), full(ZERO)
    if lanes_of(which):
        for k in range(state.shape[1]):
            intensity, term = load(state, i, k, INTENSITY, j), terms_at(terms, i, k, j)
            there = which & (intensity > ZERO)
            response += where(there, term.value, ZERO)
            photons += where(there, term.counts, ZERO)
            expected += where(there, term.exposure * intensity, ZERO)
    store(out, i, 0, j, response)
    store(out, i, 1, j, photons)
    store(out, i, 2, j, expected)


@line
def _refused(i, j, radius, likeness, frame, shown):
    """Pixels whose photons, summed over a square, speak against a surface; and response and number of these photons."""
    response, photons = _around(shown, i, 0, j, radius), _around(shown, i, 1, j, radius)
    expected = _around(shown, i, 2, j, radius)
    return llr(response, photons, expected, likeness, frame) < ZERO, response, photons


# ---- Growth

@line
def _find_new(i, state, terms, had, new, stays):
    """Write v, n and g r of the new pixels of a row, and 1 where there are points; whether any are new."""
    found = False
    for j in columns(state):
        there = full(False)
        for k in range(state.shape[1]):
            there |= load(state, i, k, INTENSITY, j) > ZERO
        is_new = there & (load(had, i, j) == ZERO)
        _write_shown(is_new, i, j, state, terms, new)
        store(stays, i, 0, j, where(there, ONE, ZERO))
        found |= lanes_of(is_new) > 0
    return found


@line
def _judge_new(i, frame, new, stays):
    """Write 0 where nothing shows a new pixel of the row."""
    for j in columns(new):
        goes = load(new, i, 2, j) > ZERO
        if lanes_of(goes):
            goes &= _refused(i, j, 0, LIKENESS, frame, new)[0]
            if lanes_of(goes):
                goes &= _refused(i, j, NEW_RADIUS, LIKENESS, frame, new)[0]
                store(stays, i, 0, j, where(goes, ZERO, load(stays, i, 0, j)))


@line
def _remove_new(i, new, stays, state, terms):
    """Remove the points of new pixels that nothing shows and that are no holes."""
    for j in columns(state):
        goes = (load(new, i, 2, j) > ZERO) & (load(stays, i, 0, j) == ZERO)
        if lanes_of(goes):
            sides = full(ZERO)
            for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1)):
                side = full(ZERO)
                for distance in range(1, HOLE + 1):
                    side = max(side, load(stays, i + distance * down, 0, j + distance * right))
                sides += side
            goes &= sides < HOLE_SIDES
            for k in range(state.shape[1]):
                store(state, i, k, INTENSITY, j, where(goes, ZERO, load(state, i, k, INTENSITY, j)))
                for f in range(TERMS):
                    store(terms, i, k, f, j, where(goes, ZERO, load(terms, i, k, f, j)))


@parallel
def _refuse(frame: Frame, state: floats4d, terms: floats4d, had: floats2d, new: floats3d, stays: floats3d,
            found: boolean[::1]):
    for i in prange(MARGIN, len(state) - MARGIN):
        found[i] = _find_new(i, state, terms, had, new, stays)
    for i in prange(MARGIN, len(state) - MARGIN):
        if found[i]:
            _judge_new(i, frame, new, stays)
    for i in prange(MARGIN, len(state) - MARGIN):
        if found[i]:
            _remove_new(i, new, stays, state, terms)


def refuse_growth(work, frame, state, terms):
    """Remove the points that the change since `work.had`, and their terms, should not have made, in place."""
    _refuse(frame, state, terms, work.had, work.rim, work.blank, np.zeros(len(state), np.bool_))


# ---- Ghosts

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


@each_row
def _drop_ghosts(i, frame: Frame, kept: floats3d, stale: boolean[:, ::1], state: floats4d):
    _judge_surfaces(i, frame, state, kept, stale)
    _move_up(i, kept, stale, state)


def drop_ghosts(work, frame, state):
    """`work.stale` says which vectors of pixels have lost some."""
    if state.shape[1] > 1:
        _drop_ghosts(frame, work.ratios, work.stale, state)


# ---- Outlines

@line
def _find_blank(i, frame, state, blank):
    """Write 1 where a used pixel has no surface, else 0."""
    for j in columns(state):
        is_blank = load(frame.exposure, i, j) > ZERO
        for k in range(state.shape[1]):
            is_blank &= ~is_surface(point_at(state, i, k, j), frame)
        store(blank, i, 0, j, where(is_blank, ONE, ZERO))


@line
def _drop_rim(i, rim, frame, enough, state):
    """Remove the points that the rim does not show; whether there are any."""
    dropped = False
    for j in columns(state):
        at_rim = load(rim, i, 2, j) > ZERO
        if lanes_of(at_rim):
            refused, response, photons = _refused(i, j, VOTE_RADIUS, ONE, frame, rim)
            score = score_of(response, photons, frame)
            for k in range(state.shape[1]):
                point = point_at(state, i, k, j)
                goes = at_rim & refused & (point.intensity > ZERO) & (score <= enough * noise_at(frame, point.depth))
                store(state, i, k, INTENSITY, j, where(goes, ZERO, point.intensity))
                dropped |= lanes_of(goes) > 0
    return dropped


@parallel
def _trim(frame: Frame, enough: float32, state: floats4d, terms: floats4d, blank: floats3d, rim: floats3d,
          dropped: boolean[::1]):
    """Remove the points of rims once; `dropped` are the rows that lose some."""
    for i in prange(MARGIN, len(state) - MARGIN):
        _find_blank(i, frame, state, blank)
    for i in prange(MARGIN, len(state) - MARGIN):
        for j in columns(state):
            at_rim = (load(blank, i, 0, j) == ZERO) & (_around(blank, i, 0, j, 1) >= RIM)
            _write_shown(at_rim, i, j, state, terms, rim)
    for i in prange(MARGIN, len(state) - MARGIN):
        dropped[i] = _drop_rim(i, rim, frame, enough, state)


def trim(work, frame, state, terms, enough):
    dropped = np.zeros(len(state), np.bool_)
    for _ in range(TRIMMED):
        _trim(frame, F32(enough), state, terms, work.blank, work.rim, dropped)
        if not dropped.any():
            break


# ---- Blobs

@line
def _find_sure(i, frame, state, enough, sure):
    """Write 1 where a pixel has a point with a score of `enough`, else 0."""
    for j in columns(state):
        is_sure = full(False)
        for k in range(state.shape[1]):
            point = point_at(state, i, k, j)
            is_sure |= (point.intensity > ZERO) & (point.score / noise_at(frame, point.depth) >= enough)
        store(sure, i, j, where(is_sure, ONE, ZERO))


@line
def _keep_near(i, sure, state):
    """Remove points without a sure one around."""
    for j in columns(state):
        near, a = load(sure, i, j), i - BLOB_RADIUS
        while a <= i + BLOB_RADIUS and lanes_of(near == ZERO):
            for b in range(j - BLOB_RADIUS, j + BLOB_RADIUS + 1):
                near = max(near, load(sure, a, b))
            a += 1
        for k in range(state.shape[1]):
            store(state, i, k, INTENSITY, j, near * load(state, i, k, INTENSITY, j))


@parallel
def _drop_blobs(frame: Frame, state: floats4d, enough: float32, sure: floats2d):
    for i in prange(MARGIN, len(state) - MARGIN):
        _find_sure(i, frame, state, enough, sure)
    for i in prange(MARGIN, len(state) - MARGIN):
        _keep_near(i, sure, state)


def drop_blobs(work, frame, state, enough):
    _drop_blobs(frame, state, F32(enough), work.had)
