"""Matched sketches, z_l = equaliser_l · sums_l − taken · passed_l β_l, and what is left of them beside known surfaces.

`residual` is z_l − Σ_{k ≠ layer} (v_k / E)₊ |ĥ_l|² exp(i ω_l t_k).
"""

import numpy as np
from numba import complex64, float32, int64, prange

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.cpu.arithmetic import ZERO, sincos
from srt3d_ros.kernels.cpu.compiling import line, parallel, read_only
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.cpu.vectors import lanes_of, load, store, where
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, LANES, MARGIN, VALUE

SUMS = read_only(complex64[:, :, ::1])
NOTHING = np.zeros((0, 0), np.float32), np.zeros((1, 1, 0), np.complex64), np.zeros(0, np.complex64)


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
                matched[i, l, j] = z.real * e.real - z.imag * e.imag
                matched[i, m + l, j] = z.real * e.imag + z.imag * e.real
            for j in range(cols if len(taken) > 0 else 0):
                q, b = passed[i * passed_by_row, j * passed_by_col, l], mean[l]
                matched[i, l, j] -= taken[i, j] * (q.real * b.real - q.imag * b.imag)
                matched[i, m + l, j] -= taken[i, j] * (q.real * b.imag + q.imag * b.real)
        for j in range(cols):
            counts[i, j] = photons[i, j] * used[i, j]


def prepare(work, sums, photons, equaliser, used, taken=None, passed=None, mean=None):
    rows, cols = photons.shape
    if taken is None:
        taken, passed, mean = NOTHING
    _prepare(sums, photons, equaliser, used, taken, passed, mean,
             maps.crop(work.matched, rows, cols), maps.crop(work.counts, rows, cols))
    return work.matched, work.counts


@line
def _residual_of_row(i, frame, state, terms, layer, rest):
    m = len(frame.energy)
    for j in range(MARGIN, state.shape[3] - MARGIN, LANES):
        for l in range(m):
            re, im = load(frame.matched, i, l, j), load(frame.matched, i, m + l, j)
            for k in range(state.shape[1]):
                there = load(state, i, k, INTENSITY, j) > ZERO
                if k != layer and lanes_of(there):
                    signal = where(there, max(load(terms, i, k, VALUE, j), ZERO) / frame.total_energy, ZERO)
                    sine, cosine = sincos(frame.bin_frequencies[l] * load(state, i, k, DEPTH, j))
                    re, im = re - signal * frame.energy[l] * cosine, im - signal * frame.energy[l] * sine
            store(rest, i, l, j, re)
            store(rest, i, m + l, j, im)


@parallel
def _residual(frame: Frame, state: float32[:, :, :, ::1], terms: float32[:, :, :, ::1], layer: int64,
              rest: float32[:, :, ::1]):
    for turn in prange(len(state) - 2 * MARGIN):
        _residual_of_row(turn + MARGIN, frame, state, terms, layer, rest)


def residual(work, frame, state, terms, layer):
    _residual(frame, state, terms, layer, work.residual)
    return work.residual
