"""Trim outlines: remove the points of a rim that the photons of the rim do not show.

A pixel with a surface is at the rim if RIM of the 8 around are used (g > 0) and have none. Over the rim within
VOTE_RADIUS, V = Σ v, p = Σ n and μ = Σ g r are pooled. Its points go if √p ρ(V₊ / p) ≤ enough · c(t) and the
log-likelihood ratio of V, p and μ is below 0. That is done SPREAD times: surfaces grow by as many pixels an iteration.
"""

import numpy as np
from numba import boolean, float32, prange

from srt3d_ros.kernels.constants import RIM, SPREAD, VOTE_RADIUS
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO, is_surface
from srt3d_ros.kernels.cpu.compiling import line, parallel
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.cpu.method.likelihood import llr, noise_at, score_of
from srt3d_ros.kernels.cpu.vectors import full, lanes_of, load, store, where
from srt3d_ros.kernels.maps import COUNTS, DEPTH, EXPOSURE, INTENSITY, LANES, MARGIN, STD, VALUE

RESPONSE, PHOTONS, EXPECTED = range(3)      # rows of `rim`: v, n, g r


@line
def _find_blank(i, frame, state, blank):
    """Write 1 where a used pixel has no surface, else 0."""
    for j in range(MARGIN, state.shape[3] - MARGIN, LANES):
        is_blank = load(frame.exposure, i, j) > ZERO
        for k in range(state.shape[1]):
            is_blank &= ~is_surface(load(state, i, k, INTENSITY, j), load(state, i, k, STD, j), frame.max_std)
        store(blank, i, j, where(is_blank, ONE, ZERO))


@line
def _find_rim(i, state, terms, blank, rim):
    """Write v, n and g r of the pixels at rims, 0 elsewhere."""
    for j in range(MARGIN, state.shape[3] - MARGIN, LANES):
        blanks, response, photons, expected = full(ZERO), full(ZERO), full(ZERO), full(ZERO)
        for a in range(i - 1, i + 2):
            for b in range(j - 1, j + 2):
                blanks += load(blank, a, b)
        at_rim = (load(blank, i, j) == ZERO) & (blanks >= RIM)
        for k in range(state.shape[1]):
            intensity = load(state, i, k, INTENSITY, j)
            there = at_rim & (intensity > ZERO)
            response += where(there, load(terms, i, k, VALUE, j), ZERO)
            photons += where(there, load(terms, i, k, COUNTS, j), ZERO)
            expected += where(there, load(terms, i, k, EXPOSURE, j) * intensity, ZERO)
        store(rim, i, RESPONSE, j, response)
        store(rim, i, PHOTONS, j, photons)
        store(rim, i, EXPECTED, j, expected)


@line
def _drop_row(i, rim, frame, enough, state):
    """Remove the points that the rim does not show; whether there are any."""
    dropped = False
    for j in range(MARGIN, state.shape[3] - MARGIN, LANES):
        at_rim = load(rim, i, EXPECTED, j) > ZERO
        if lanes_of(at_rim):
            response, photons, expected = full(ZERO), full(ZERO), full(ZERO)
            for a in range(i - VOTE_RADIUS, i + VOTE_RADIUS + 1):
                for b in range(j - VOTE_RADIUS, j + VOTE_RADIUS + 1):
                    response += load(rim, a, RESPONSE, b)
                    photons += load(rim, a, PHOTONS, b)
                    expected += load(rim, a, EXPECTED, b)
            score = score_of(response, photons, frame)
            unlikely = at_rim & (llr(response, photons, expected, ONE, frame) < ZERO)
            for k in range(state.shape[1]):
                intensity, noise = load(state, i, k, INTENSITY, j), noise_at(frame, load(state, i, k, DEPTH, j))
                goes = unlikely & (intensity > ZERO) & (score <= enough * noise)
                store(state, i, k, INTENSITY, j, where(goes, ZERO, intensity))
                dropped |= lanes_of(goes) > 0
    return dropped


@parallel
def _trim(frame: Frame, enough: float32, state: float32[:, :, :, ::1], terms: float32[:, :, :, ::1],
          blank: float32[:, ::1], rim: float32[:, :, ::1], dropped: boolean[::1]):
    """Remove the points of rims once; `dropped` are the rows that lose some."""
    for turn in prange(len(dropped)):
        _find_blank(turn + MARGIN, frame, state, blank)
    for turn in prange(len(dropped)):
        _find_rim(turn + MARGIN, state, terms, blank, rim)
    for turn in prange(len(dropped)):
        dropped[turn] = _drop_row(turn + MARGIN, rim, frame, enough, state)


def trim(work, frame, state, terms, enough):
    dropped = np.zeros(len(state) - 2 * MARGIN, np.bool_)
    for _ in range(SPREAD):
        _trim(frame, F32(enough), state, terms, work.blank, work.rim, dropped)
        if not dropped.any():
            break
