"""Trim outlines: remove the points of a rim that the photons of the rim do not show.

A pixel with a surface is at the rim if RIM of the 8 around are used (g > 0) and have none. Over the rim within
VOTE_RADIUS, V = Σ v, p = Σ n and μ = Σ g r are pooled. Its points go if √p ρ(V₊ / p) ≤ enough · c(t) and the
log-likelihood ratio of V, p and μ is below 0. That is done TRIMMED times, a pixel each.

Drop blobs: of the points that are left, those stay that have one with score / c(t) of `enough` within the reach of the
last window (a square).
"""

from math import ceil

import numpy as np
from numba import boolean, float32, prange

from srt3d_ros.kernels.constants import REACH, RIM, TRIMMED, VOTE_RADIUS, WINDOWS
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO
from srt3d_ros.kernels.cpu.compiling import floats2d, floats3d, floats4d, inline, line, parallel
from srt3d_ros.kernels.cpu.method.frame import Frame, columns, is_surface, point_at
from srt3d_ros.kernels.cpu.method.likelihood import EXPECTED, PHOTONS, RESPONSE, llr, noise_at, score_of, write_shown
from srt3d_ros.kernels.cpu.vectors import full, lanes_of, load, store, where
from srt3d_ros.kernels.maps import INTENSITY, MARGIN

RADIUS = ceil(REACH * WINDOWS[-1].sigma)


@line
def _find_blank(i, frame, state, blank):
    """Write 1 where a used pixel has no surface, else 0."""
    for j in columns(state):
        is_blank = load(frame.exposure, i, j) > ZERO
        for k in range(state.shape[1]):
            is_blank &= ~is_surface(point_at(state, i, k, j), frame)
        store(blank, i, 0, j, where(is_blank, ONE, ZERO))


@inline
def _around(values, i, c, j, radius):
    """The sums over the squares around pixels."""
    value = full(ZERO)
    for a in range(i - radius, i + radius + 1):
        for b in range(j - radius, j + radius + 1):
            value += load(values, a, c, b)
    return value


@line
def _find_rim(i, state, terms, blank, rim):
    """Write v, n and g r of the pixels at rims, 0 elsewhere."""
    for j in columns(state):
        at_rim = (load(blank, i, 0, j) == ZERO) & (_around(blank, i, 0, j, 1) >= RIM)
        write_shown(at_rim, i, j, state, terms, rim)


@line
def _drop_row(i, rim, frame, enough, state):
    """Remove the points that the rim does not show; whether there are any."""
    dropped = False
    for j in columns(state):
        at_rim = load(rim, i, EXPECTED, j) > ZERO
        if lanes_of(at_rim):
            response, photons = _around(rim, i, RESPONSE, j, VOTE_RADIUS), _around(rim, i, PHOTONS, j, VOTE_RADIUS)
            expected, score = _around(rim, i, EXPECTED, j, VOTE_RADIUS), score_of(response, photons, frame)
            unlikely = at_rim & (llr(response, photons, expected, ONE, frame) < ZERO)
            for k in range(state.shape[1]):
                point = point_at(state, i, k, j)
                goes = unlikely & (point.intensity > ZERO) & (score <= enough * noise_at(frame, point.depth))
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
        _find_rim(i, state, terms, blank, rim)
    for i in prange(MARGIN, len(state) - MARGIN):
        dropped[i] = _drop_row(i, rim, frame, enough, state)


def trim(work, frame, state, terms, enough):
    dropped = np.zeros(len(state), np.bool_)
    for _ in range(TRIMMED):
        _trim(frame, F32(enough), state, terms, work.blank, work.rim, dropped)
        if not dropped.any():
            break


@line
def _find_sure(i, frame, state, enough, sure):
    for j in columns(state):
        is_sure = full(False)
        for k in range(state.shape[1]):
            point = point_at(state, i, k, j)
            is_sure |= (point.intensity > ZERO) & (point.score / noise_at(frame, point.depth) >= enough)
        store(sure, i, 0, j, where(is_sure, ONE, ZERO))


@line
def _look_down(i, sure, near):
    """Write the highest of the column within RADIUS."""
    for j in columns(sure):
        highest = full(ZERO)
        for a in range(i - RADIUS, i + RADIUS + 1):
            highest = max(highest, load(sure, a, 0, j))
        store(near, i, j, highest)


@line
def _keep_near(i, near, state):
    for j in columns(state):
        highest = full(ZERO)
        for b in range(j - RADIUS, j + RADIUS + 1):
            highest = max(highest, load(near, i, b))
        for k in range(state.shape[1]):
            store(state, i, k, INTENSITY, j, highest * load(state, i, k, INTENSITY, j))


@parallel
def _drop_blobs(frame: Frame, state: floats4d, enough: float32, sure: floats3d, near: floats2d):
    for i in prange(MARGIN, len(state) - MARGIN):
        _find_sure(i, frame, state, enough, sure)
    for i in prange(MARGIN, len(state) - MARGIN):
        _look_down(i, sure, near)
    for i in prange(MARGIN, len(state) - MARGIN):
        _keep_near(i, near, state)


def drop_blobs(work, frame, state, enough):
    _drop_blobs(Frame.of(frame), state, F32(enough), work.blank, work.had)
