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
from numba import boolean, float32

from srt3d_ros.kernels.constants import (
    EPSILON,
    HOLE,
    HOLE_SIDES,
    LIKENESS,
    NEW_RADIUS,
    REACH,
    RIM,
    TRIMMED,
    VOTE_RADIUS,
    WINDOWS,
    WRONG_SHAPE,
)
from srt3d_ros.kernels.cpu.arithmetic import F32
from srt3d_ros.kernels.cpu.compiling import each, floats2d, floats3d, floats4d, inline
from srt3d_ros.kernels.cpu.method.frame import Frame, is_surface, point_at
from srt3d_ros.kernels.cpu.method.likelihood import by_bin, llr, noise_at, score_of
from srt3d_ros.kernels.cpu.vectors import full, lanes_of, where
from srt3d_ros.kernels.maps import COUNTS, DEPTH, EXPOSURE, FIELDS, INTENSITY, TERMS, VALUE

BLOB_RADIUS = ceil(REACH * WINDOWS[-1].sigma)


@inline
def _write_shown(which, i, j, state, terms, out):
    """Write v, n and g r of the points of those pixels (i, j) that `which` selects, 0 elsewhere."""
    response, photons, expected = full(0.0), full(0.0), full(0.0)
    for k in range(state.shape[1] if lanes_of(which) else 0):
        intensity = state[i, k, INTENSITY, j]
        there = which & (intensity > 0)
        response += where(there, terms[i, k, VALUE, j], 0)
        photons += where(there, terms[i, k, COUNTS, j], 0)
        expected += where(there, terms[i, k, EXPOSURE, j] * intensity, 0)
    out[i, 0, j], out[i, 1, j], out[i, 2, j] = response, photons, expected


@inline
def _around(values, i, c, j, radius):
    """The sums over the squares around pixels."""
    value = full(0.0)
    for a in range(i - radius, i + radius + 1):
        for b in range(-radius, radius + 1):
            value += values[a, c, j + b]
    return value


@inline
def _refused(i, j, radius, likeness, frame, shown):
    """Pixels whose photons, summed over a square, speak against a surface; and response and number of these photons."""
    response, photons = _around(shown, i, 0, j, radius), _around(shown, i, 1, j, radius)
    expected = _around(shown, i, 2, j, radius)
    return llr(response, photons, expected, likeness, frame) < 0, response, photons


# ---- Growth

def _find_new(i, j, terms: floats4d, had: floats2d, new: floats3d, stays: floats2d, state: floats4d):
    """Write v, n and g r of new pixels, and 1 where there are points."""
    there = full(False)
    for k in range(state.shape[1]):
        there |= state[i, k, INTENSITY, j] > 0
    _write_shown(there & (had[i, j] == 0), i, j, state, terms, new)
    stays[i, j] = where(there, 1, 0)


def _judge_new(i, j, frame: Frame, new: floats3d, stays: floats2d):
    """Write 0 where nothing shows a new pixel."""
    goes = new[i, 2, j] > 0
    if lanes_of(goes):
        goes &= _refused(i, j, 0, LIKENESS, frame, new)[0]
        if lanes_of(goes):
            goes &= _refused(i, j, NEW_RADIUS, LIKENESS, frame, new)[0]
            stays[i, j] = where(goes, 0, stays[i, j])


def _remove_new(i, j, terms: floats4d, new: floats3d, stays: floats2d, state: floats4d):
    """Remove the points of new pixels that nothing shows and that are no holes."""
    goes = (new[i, 2, j] > 0) & (stays[i, j] == 0)
    if lanes_of(goes):
        sides = full(0.0)
        for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            side = full(0.0)
            for distance in range(1, HOLE + 1):
                side = max(side, stays[i + distance * down, j + distance * right])
            sides += side
        goes &= sides < HOLE_SIDES
        for k in range(state.shape[1]):
            state[i, k, INTENSITY, j] = where(goes, 0, state[i, k, INTENSITY, j])
            for term in range(TERMS):
                terms[i, k, term, j] = where(goes, 0, terms[i, k, term, j])


_refuse_growth = each(_find_new, _judge_new, _remove_new)


def refuse_growth(work, frame, state, terms, had):
    """Remove the points of pixels that `had` none, and their terms, that nothing shows, in place."""
    _refuse_growth(terms, had, work.map("new", 3), work.map("stays"), state, frame)


# ---- Ghosts

def _find_ghosts(i, j, frame: Frame, kept: floats3d, stale: floats2d, state: floats4d):
    """Write the intensities of points, 0 for ghosts, and 1 where a pixel has any."""
    further, has_ghost = full(False), full(False)
    for k in range(1, state.shape[1]):
        further |= state[i, k, INTENSITY, j] > 0
    for k in range(state.shape[1] if lanes_of(further) else 0):
        own, depth = state[i, k, INTENSITY, j], state[i, k, DEPTH, j]
        stronger, shown = full(0.0), own
        for o in range(state.shape[1]):
            if o != k:
                other = state[i, o, INTENSITY, j]
                is_stronger = ((other > own) | ((other == own) & (o < k))) & (other > 0)
                stronger += where(is_stronger, other, 0)
                shown *= where(is_stronger, by_bin(frame.unlike, depth - state[i, o, DEPTH, j]), 1)
        light = frame.counts[i, j] / max(frame.exposure[i, j], EPSILON)
        ghost = (own > 0) & (shown < WRONG_SHAPE * min(stronger, light))
        has_ghost |= ghost
        kept[i, k, j] = where(ghost, 0, own)
    stale[i, j] = where(has_ghost, 1, 0)


def _move_up(i, j, kept: floats3d, stale: floats2d, state: floats4d):
    """Take the intensities that are kept, and move surfaces down into gaps."""
    if lanes_of(stale[i, j] > 0):
        for k in range(state.shape[1]):
            state[i, k, INTENSITY, j] = kept[i, k, j]
        for last in range(state.shape[1] - 1, 0, -1):
            for k in range(last):
                gap = (state[i, k, INTENSITY, j] <= 0) & (state[i, k + 1, INTENSITY, j] > 0)
                for f in range(FIELDS if lanes_of(gap) else 0):
                    low, high = state[i, k, f, j], state[i, k + 1, f, j]
                    state[i, k, f, j], state[i, k + 1, f, j] = where(gap, high, low), where(gap, low, high)


_drop_ghosts = each(_find_ghosts, _move_up)


def drop_ghosts(work, frame, state):
    """Afterwards, the map "stale" has 1 where a pixel has lost some."""
    if state.shape[1] > 1:
        _drop_ghosts(frame, work.map("kept", work.surfaces), work.map("stale"), state)


# ---- Outlines

def _find_blank(i, j, frame: Frame, blank: floats3d, state: floats4d):
    """Write 1 where a used pixel has no surface, else 0."""
    is_blank = frame.exposure[i, j] > 0
    for k in range(state.shape[1]):
        is_blank &= ~is_surface(point_at(state, i, k, j), frame)
    blank[i, 0, j] = where(is_blank, 1, 0)


def _find_rim(i, j, blank: floats3d, terms: floats4d, rim: floats3d, state: floats4d):
    _write_shown((blank[i, 0, j] == 0) & (_around(blank, i, 0, j, 1) >= RIM), i, j, state, terms, rim)


def _drop_rim(i, j, frame: Frame, rim: floats3d, enough: float32, dropped: boolean[::1], state: floats4d):
    """Remove the points that the rim does not show; `dropped` are the rows that lose some."""
    at_rim = rim[i, 2, j] > 0
    if lanes_of(at_rim):
        refused, response, photons = _refused(i, j, VOTE_RADIUS, 1, frame, rim)
        score = score_of(response, photons, frame)
        for k in range(state.shape[1]):
            point = point_at(state, i, k, j)
            goes = at_rim & refused & (point.intensity > 0) & (score <= enough * noise_at(frame, point.depth))
            state[i, k, INTENSITY, j] = where(goes, 0, point.intensity)
            if lanes_of(goes):
                dropped[i] = True


_trim = each(_find_blank, _find_rim, _drop_rim)


def trim(work, frame, state, terms, enough):
    dropped = np.ones(work.height, np.bool_)
    for _ in range(TRIMMED):
        if dropped.any():
            dropped[:] = False
            _trim(frame, work.map("blank", 1), state, terms, work.map("rim", 3), F32(enough), dropped)


# ---- Blobs

def _find_sure(i, j, frame: Frame, enough: float32, sure: floats2d, state: floats4d):
    """Write 1 where a pixel has a point with a score of `enough`, else 0."""
    is_sure = full(False)
    for k in range(state.shape[1]):
        point = point_at(state, i, k, j)
        is_sure |= (point.intensity > 0) & (point.score / noise_at(frame, point.depth) >= enough)
    sure[i, j] = where(is_sure, 1, 0)


def _keep_near(i, j, sure: floats2d, state: floats4d):
    """Remove points without a sure one around."""
    near, a = sure[i, j], i - BLOB_RADIUS
    while a <= i + BLOB_RADIUS and lanes_of(near == 0):
        for b in range(-BLOB_RADIUS, BLOB_RADIUS + 1):
            near = max(near, sure[a, j + b])
        a += 1
    for k in range(state.shape[1]):
        state[i, k, INTENSITY, j] = near * state[i, k, INTENSITY, j]


_drop_blobs = each(_find_sure, _keep_near)


def drop_blobs(work, frame, state, enough):
    _drop_blobs(frame, F32(enough), work.map("sure"), state)
