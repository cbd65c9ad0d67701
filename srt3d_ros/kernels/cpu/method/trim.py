"""Trims outlines: the points of rims that their own photons do not pay for are removed."""

import numpy as np
from numba import boolean, float32, prange

from srt3d_ros.kernels.constants import RIM, SPREAD, VOTE_RADIUS
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO
from srt3d_ros.kernels.cpu.compiling import parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.method.field import is_surface
from srt3d_ros.kernels.cpu.method.frame import FRAME, as_compiled
from srt3d_ros.kernels.cpu.method.likelihood import llr, noise_at, score_of
from srt3d_ros.kernels.maps import COUNTS, DEPTH, EXPOSURE, INTENSITY, MARGIN, STD, VALUE


@parallel
def _mark(frame: FRAME, state: float32[:, :, :, ::1], terms: float32[:, :, :, ::1], blank: float32[:, ::1],
          rim: float32[:, :, ::1]):
    """Write response, photons and expected photons of the pixels at rims, 0 elsewhere; 1 in `blank` where none is."""
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
            rim[i, 0, j], rim[i, 1, j], rim[i, 2, j], empty = ZERO, ZERO, ZERO, ZERO
            for a in range(i - 1, i + 2):
                empty += blank[a, j - 1] + blank[a, j] + blank[a, j + 1]
            if blank[i, j] > ZERO or empty < F32(RIM):
                continue
            for k in range(surfaces):
                intensity = state[i, k, INTENSITY, j]
                if intensity > ZERO:
                    rim[i, 0, j] += terms[i, k, VALUE, j]
                    rim[i, 1, j] += terms[i, k, COUNTS, j]
                    rim[i, 2, j] += terms[i, k, EXPOSURE, j] * intensity


@parallel
def _drop(rim: float32[:, :, ::1], frame: FRAME, enough: float32, state: float32[:, :, :, ::1], dropped: boolean[::1]):
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
    rim, blank = borrow("rim", (len(state), 3, state.shape[3])), borrow("blank", frame.counts.shape)
    compiled, dropped = as_compiled(frame), np.zeros(len(state), np.bool_)
    for _ in range(SPREAD):
        _mark(compiled, state, terms, blank, rim)
        _drop(rim, compiled, F32(enough), state, dropped)
        if not dropped.any():
            break
