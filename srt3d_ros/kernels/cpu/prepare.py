"""Sketches as the iterations want them, one plane for each part of each frequency, and what known surfaces leave."""

import numpy as np
from numba import prange

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.cpu.arithmetic import F32, ZERO, sincos, total_of
from srt3d_ros.kernels.cpu.compiling import parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, MARGIN, VALUE


@parallel
def _prepare(sums, photons, equaliser, used, taken, shown, matched, counts):
    rows, cols, twice = sums.shape
    m, by_row, by_col = twice // 2, min(equaliser.shape[0] - 1, 1), min(equaliser.shape[1] - 1, 1)
    shown_by_row, shown_by_col = min(shown.shape[0] - 1, 1), min(shown.shape[1] - 1, 1)
    none = taken.shape[0] == 0
    for i in prange(rows):
        a = i * by_row
        for j in range(cols):
            b = j * by_col
            e, f = i * shown_by_row, j * shown_by_col
            less = ZERO if none else taken[i, j]
            counts[i + MARGIN, j + MARGIN] = F32(photons[i, j]) * used[i, j]
            for l in range(m):
                re, im = sums[i, j, 2 * l], sums[i, j, 2 * l + 1]
                c, d = equaliser[a, b, 2 * l], equaliser[a, b, 2 * l + 1]
                matched[i + MARGIN, l, j + MARGIN] = re * c - im * d - less * shown[e, f, 2 * l]
                matched[i + MARGIN, m + l, j + MARGIN] = re * d + im * c - less * shown[e, f, 2 * l + 1]


def prepare(sums, photons, equaliser, used, taken=None, shown=None):
    rows, cols, m = sums.shape
    padded_rows, padded_cols = maps.padded_shape(rows, cols)
    matched = borrow("matched", (padded_rows, 2 * m, padded_cols))
    counts = borrow("counts", (padded_rows, padded_cols))
    if taken is None:
        taken, shown = np.empty((0, 0), np.float32), np.zeros((1, 1, m), np.complex64)
    _prepare(np.ascontiguousarray(sums).view(np.float32), np.ascontiguousarray(photons), equaliser.view(np.float32),
             used, taken, shown.view(np.float32), matched, counts)
    return matched, counts


@parallel
def _residual(matched, energy, bin_frequencies, state, terms, layer, rest):
    padded_rows, surfaces, _, padded_cols = state.shape
    m, total = len(energy), total_of(energy)
    for i in prange(padded_rows):
        for l in range(2 * m):
            for j in range(padded_cols):
                rest[i, l, j] = matched[i, l, j]
        for j in range(padded_cols):
            for k in range(surfaces):
                if k != layer and state[i, k, INTENSITY, j] > ZERO:
                    signal = max(terms[i, k, VALUE, j], ZERO) / total
                    for l in range(m):
                        sine, cosine = sincos(bin_frequencies[l] * state[i, k, DEPTH, j])
                        rest[i, l, j] -= signal * energy[l] * cosine
                        rest[i, m + l, j] -= signal * energy[l] * sine


def residual(frame, state, terms, layer):
    rest = borrow("residual", frame.matched.shape)
    _residual(frame.matched, frame.energy, frame.bin_frequencies, state, terms, layer, rest)
    return rest
