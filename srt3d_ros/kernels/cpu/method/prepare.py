"""Matched sketches, z_l = equaliser_l · sums_l − taken · passed_l β_l, and what is left of them beside known surfaces.

`residual` is z_l − Σ_{k ≠ layer} (v_k / E)₊ |ĥ_l|² exp(i ω_l t_k).
"""

import numpy as np
from numba import complex64, float32, int64, prange

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.cpu.arithmetic import ZERO, sincos, total_of
from srt3d_ros.kernels.cpu.compiling import parallel, read_only
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, VALUE

SUMS = read_only(complex64[:, :, ::1])


@parallel
def _prepare(sums: SUMS, photons: float32[:, ::1], equaliser: complex64[:, :, ::1], used: float32[:, ::1],
             taken: float32[:, ::1], passed: complex64[:, :, ::1], mean: complex64[::1],
             matched: float32[:, :, :], counts: float32[:, :]):
    rows, cols, m = sums.shape
    by_row, by_col = min(len(equaliser) - 1, 1), min(equaliser.shape[1] - 1, 1)
    passed_by_row, passed_by_col = min(len(passed) - 1, 1), min(passed.shape[1] - 1, 1)
    for i in prange(rows):
        for l in range(m):
            for j in range(cols):           # by parts: processors round complex products differently
                z, e = sums[i, j, l], equaliser[i * by_row, j * by_col, l]
                q, b = passed[i * passed_by_row, j * passed_by_col, l], mean[l]
                matched[i, l, j] = z.real * e.real - z.imag * e.imag - taken[i, j] * (q.real * b.real - q.imag * b.imag)
                matched[i, m + l, j] = (z.real * e.imag + z.imag * e.real
                                        - taken[i, j] * (q.real * b.imag + q.imag * b.real))
        for j in range(cols):
            counts[i, j] = photons[i, j] * used[i, j]


def prepare(sums, photons, equaliser, used, taken=None, passed=None, mean=None):
    rows, cols, m = sums.shape
    padded_rows, padded_cols = maps.padded_shape(rows, cols)
    matched, counts = borrow("matched", (padded_rows, 2 * m, padded_cols)), borrow("counts", (padded_rows, padded_cols))
    if taken is None:
        taken = np.zeros((rows, cols), np.float32)
        passed, mean = np.zeros((1, 1, m), np.complex64), np.zeros(m, np.complex64)
    _prepare(sums, photons, equaliser, used, taken, passed, mean,
             maps.crop(matched, rows, cols), maps.crop(counts, rows, cols))
    return matched, counts


@parallel
def _residual(matched: float32[:, :, ::1], energy: float32[::1], bin_frequencies: float32[::1],
              state: float32[:, :, :, ::1], terms: float32[:, :, :, ::1], layer: int64, rest: float32[:, :, ::1]):
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
