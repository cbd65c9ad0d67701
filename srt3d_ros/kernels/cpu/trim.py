"""Trims outlines: the points of rims that their own photons do not pay for are removed."""

import numpy as np
from numba import prange

from srt3d_ros.kernels.constants import RIM, SPREAD, VOTE_RADIUS
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO
from srt3d_ros.kernels.cpu.compiling import line, parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.field import is_surface
from srt3d_ros.kernels.cpu.likelihood import llr, score_of
from srt3d_ros.kernels.maps import COUNTS, DEPTH, EXPOSURE, INTENSITY, MARGIN, MAX_STD, STD, VALUE


@line
def _surfaces(state, i, max_std, there):
    """Write 1 for the pixels of row i that have a surface, 0 for the others."""
    there[:] = ZERO
    for k in range(state.shape[1]):
        for j in range(len(there)):
            found = is_surface(state[i, k, INTENSITY, j], state[i, k, STD, j], max_std)
            there[j] = ONE if found else there[j]


@parallel
def _mark(exposure, state, terms, max_std, rim):
    """Write response, photons and expected photons of the pixels at rims, 0 elsewhere."""
    padded_rows, surfaces, _, padded_cols = state.shape
    for turn in prange(padded_rows - 2 * MARGIN):
        i = turn + MARGIN
        there, blank = np.empty(padded_cols, np.float32), np.zeros(padded_cols, np.float32)
        for a in range(i - 1, i + 2):
            _surfaces(state, a, max_std, there)
            for j in range(padded_cols):
                blank[j] += ONE - there[j] if exposure[a, j] > ZERO else ZERO
        _surfaces(state, i, max_std, there)
        for j in range(1, padded_cols - 1):
            there[j] = there[j] if blank[j - 1] + blank[j] + blank[j + 1] >= F32(RIM) else ZERO
        for c in range(3):
            for j in range(padded_cols):
                rim[i, c, j] = ZERO
        for k in range(surfaces):
            for j in range(padded_cols):
                at_rim = there[j] if state[i, k, INTENSITY, j] > ZERO else ZERO
                rim[i, 0, j] += at_rim * terms[i, k, VALUE, j]
                rim[i, 1, j] += at_rim * terms[i, k, COUNTS, j]
                rim[i, 2, j] += at_rim * terms[i, k, EXPOSURE, j] * state[i, k, INTENSITY, j]


@parallel
def _drop(rim, clutter, total, max_response, background_table, moments, enough, state, dropped):
    padded_rows, surfaces, _, padded_cols = state.shape
    for turn in prange(padded_rows - 2 * MARGIN):
        i = turn + MARGIN
        dropped[i] = False
        rows = np.empty((3, padded_cols), np.float32)
        for c in range(3):
            for j in range(padded_cols):
                total_of_rows = ZERO
                for a in range(i - VOTE_RADIUS, i + VOTE_RADIUS + 1):
                    total_of_rows += rim[a, c, j]
                rows[c, j] = total_of_rows
        for j in range(MARGIN, padded_cols - MARGIN):
            if rim[i, 2, j] <= ZERO:
                continue
            response, photons, expected = ZERO, ZERO, ZERO
            for b in range(j - VOTE_RADIUS, j + VOTE_RADIUS + 1):
                response += rows[0, b]
                photons += rows[1, b]
                expected += rows[2, b]
            score = score_of(response, photons, max_response, background_table)
            ratio = llr(score, response, photons, expected, ONE, total, moments)
            for k in range(surfaces):
                noise = clutter[int(np.rint(state[i, k, DEPTH, j])) % len(clutter)]
                if score <= enough * noise and ratio < ZERO:
                    state[i, k, INTENSITY, j], dropped[i] = ZERO, True


def trim(frame, state, terms, enough):
    rim = borrow("rim", (len(state), 3, state.shape[3]))
    dropped = np.zeros(len(state), np.bool_)
    clutter = np.full(1, ONE) if frame.clutter is None else frame.clutter
    for _ in range(SPREAD):
        _mark(frame.exposure, state, terms, F32(MAX_STD) * F32(frame.num_bins), rim)
        _drop(rim, clutter, F32(frame.total_energy), F32(frame.max_response), frame.background_table,
              frame.intensity_moments, F32(enough), state, dropped)
        if not dropped.any():
            break
