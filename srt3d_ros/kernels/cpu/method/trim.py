"""Trim outlines: remove the points of a rim that the photons of the rim do not show.

A pixel with a surface is at the rim if RIM of the 8 around are used (g > 0) and have none. Over the rim within
VOTE_RADIUS, V = Σ v, p = Σ n and μ = Σ g r are pooled. Its points go if √p ρ(V₊ / p) ≤ enough · c(t) and the
log-likelihood ratio of V, p and μ is below 0. That is done SPREAD times: surfaces grow by as many pixels an iteration.
"""

import numpy as np
from numba import boolean, float32, prange

from srt3d_ros.kernels.constants import RIM, SPREAD, VOTE_RADIUS
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO
from srt3d_ros.kernels.cpu.compiling import parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.method.field import is_surface
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.cpu.method.likelihood_scalar import llr, noise_at, score_of
from srt3d_ros.kernels.maps import COUNTS, DEPTH, EXPOSURE, INTENSITY, MARGIN, STD, VALUE

RESPONSE, PHOTONS, EXPECTED = range(3)      # rows of `rim`: v, n, g r


@parallel
def _mark(frame: Frame, state: float32[:, :, :, ::1], terms: float32[:, :, :, ::1], blank: float32[:, ::1],
          rim: float32[:, :, ::1]):
    """Write v, n and g r of the pixels at rims, 0 elsewhere, and 1 in `blank` where a used pixel has no surface."""
    padded_rows, surfaces, _, padded_cols = state.shape
    for i in prange(padded_rows):
        for j in range(padded_cols):
            blank[i, j] = ONE if frame.exposure[i, j] > ZERO else ZERO
            for k in range(surfaces):
                if is_surface(state[i, k, INTENSITY, j], state[i, k, STD, j], frame.max_std):
                    blank[i, j] = ZERO
    for turn in prange(padded_rows - 2 * MARGIN):
        i = turn + MARGIN
        for j in range(MARGIN, padded_cols - MARGIN):
            rim[i, RESPONSE, j] = rim[i, PHOTONS, j] = rim[i, EXPECTED, j] = empty = ZERO
            for a in range(i - 1, i + 2):
                empty += blank[a, j - 1] + blank[a, j] + blank[a, j + 1]
            if blank[i, j] > ZERO or empty < F32(RIM):
                continue
            for k in range(surfaces):
                intensity = state[i, k, INTENSITY, j]
                if intensity > ZERO:
                    rim[i, RESPONSE, j] += terms[i, k, VALUE, j]
                    rim[i, PHOTONS, j] += terms[i, k, COUNTS, j]
                    rim[i, EXPECTED, j] += terms[i, k, EXPOSURE, j] * intensity


@parallel
def _drop(rim: float32[:, :, ::1], frame: Frame, enough: float32, state: float32[:, :, :, ::1], dropped: boolean[::1]):
    """Remove the points that the rim does not show; `dropped` are the rows that lose some."""
    padded_rows, surfaces, _, padded_cols = state.shape
    for turn in prange(padded_rows - 2 * MARGIN):
        i = turn + MARGIN
        dropped[i] = False
        rows = np.empty((3, padded_cols), np.float32)
        for c in range(3):
            for j in range(padded_cols):
                total = ZERO
                for a in range(i - VOTE_RADIUS, i + VOTE_RADIUS + 1):
                    total += rim[a, c, j]
                rows[c, j] = total
        for j in range(MARGIN, padded_cols - MARGIN):
            if rim[i, EXPECTED, j] <= ZERO:
                continue
            response, photons, expected = ZERO, ZERO, ZERO
            for b in range(j - VOTE_RADIUS, j + VOTE_RADIUS + 1):
                response += rows[RESPONSE, b]
                photons += rows[PHOTONS, b]
                expected += rows[EXPECTED, b]
            score = score_of(response, photons, frame)
            ratio = llr(score, response, photons, expected, ONE, frame)
            for k in range(surfaces):
                if score <= enough * noise_at(frame, state[i, k, DEPTH, j]) and ratio < ZERO:
                    state[i, k, INTENSITY, j], dropped[i] = ZERO, True


def trim(frame, state, terms, enough):
    rim, blank = borrow("rim", (len(state), 3, state.shape[3])), borrow("blank", frame.counts.shape)
    dropped = np.zeros(len(state), np.bool_)
    for _ in range(SPREAD):
        _mark(frame, state, terms, blank, rim)
        _drop(rim, frame, F32(enough), state, dropped)
        if not dropped.any():
            break
