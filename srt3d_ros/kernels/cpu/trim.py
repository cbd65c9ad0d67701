"""Trims outlines: the points of rims that their own photons do not pay for are removed."""

import numpy as np
from numba import prange

from srt3d_ros.kernels.constants import RIM, SPREAD, VOTE_RADIUS
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO
from srt3d_ros.kernels.cpu.compiling import parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.frame import as_compiled
from srt3d_ros.kernels.cpu.likelihood import llr, noise_at, score_of
from srt3d_ros.kernels.maps import COUNTS, DEPTH, EXPOSURE, INTENSITY, MARGIN, STD, VALUE


def _mark(used, state, terms, max_std, rim):
    """Write response, photons and expected photons of the pixels at rims, 0 elsewhere."""
    intensity = state[:, :, INTENSITY]
    there = ((intensity > 0) & (state[:, :, STD] < max_std)).any(axis=1)
    blank = (used & ~there).view(np.uint8)
    rows = blank[:-2] + blank[1:-1] + blank[2:]
    there[1:-1, 1:-1] &= rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:] >= RIM
    at_rim = there[:, None] & (intensity > 0)
    for c, values in enumerate((terms[:, :, VALUE], terms[:, :, COUNTS], terms[:, :, EXPOSURE] * intensity)):
        rim[:, c] = (at_rim * values).sum(axis=1)


@parallel
def _drop(rim, frame, enough, state, dropped):
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
            score = score_of(response, photons, frame)
            ratio = llr(score, response, photons, expected, ONE, frame)
            for k in range(surfaces):
                if score <= enough * noise_at(frame, state[i, k, DEPTH, j]) and ratio < ZERO:
                    state[i, k, INTENSITY, j], dropped[i] = ZERO, True


def trim(frame, state, terms, enough):
    rim, dropped = borrow("rim", (len(state), 3, state.shape[3])), np.zeros(len(state), np.bool_)
    compiled = as_compiled(frame)
    for _ in range(SPREAD):
        _mark(frame.exposure > 0, state, terms, compiled.max_std, rim)
        _drop(rim, compiled, F32(enough), state, dropped)
        if not dropped.any():
            break
