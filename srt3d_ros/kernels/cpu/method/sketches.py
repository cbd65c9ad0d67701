"""Matched sketches, what surfaces leave of them, and the data terms of points.

    prepare:   z_l = equaliser_l · sums_l − taken · passed_l β_l
    residual:  z_l − Σ_{k ≠ layer} (v_k / E)₊ |ĥ_l|² exp(i ω_l t_k)
    expand:    f(t + d) ≈ v + s d − b d² / 2 with v = Σ Re z'_l, s = Σ ω_l Im z'_l, b = Σ ω_l² Re z'_l,
               z'_l = (z_l − g Σ_{o ≠ k} r_o |ĥ_l|² exp(i ω_l t_o)) exp(−i ω_l t_k)
"""

import numpy as np
from numba import boolean, complex64, float32, int64, prange

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.cpu.arithmetic import F32, ZERO, sincos
from srt3d_ros.kernels.cpu.compiling import each_row, floats2d, floats3d, floats4d, inline, line, parallel, read_only
from srt3d_ros.kernels.cpu.method.frame import Frame, Terms, columns, point_at, put, without
from srt3d_ros.kernels.cpu.vectors import fma, full, lanes_of, load, store, where
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, LANES, VALUE

SUMS, SPREAD = read_only(complex64[:, :, ::1]), read_only(complex64[:, :, :])
NOTHING = np.zeros((0, 0), np.float32), np.zeros((1, 1, 1), np.complex64), np.zeros(0, np.complex64)


@inline
def _product(a, b):
    """Real and imaginary part of a b, by parts: processors round complex products differently."""
    return a.real * b.real - a.imag * b.imag, a.real * b.imag + a.imag * b.real


@parallel
def _prepare(sums: SUMS, photons: floats2d, equaliser: SPREAD, used: floats2d, taken: floats2d,
             passed: SPREAD, mean: complex64[::1], matched: float32[:, :, :], counts: float32[:, :]):
    rows, cols, m = sums.shape
    for i in prange(rows):
        for l in range(m):
            for j in range(cols):
                matched[i, l, j], matched[i, m + l, j] = _product(sums[i, j, l], equaliser[i, j, l])
            for j in range(cols if len(taken) > 0 else 0):
                re, im = _product(passed[i, j, l], mean[l])
                matched[i, l, j] -= taken[i, j] * re
                matched[i, m + l, j] -= taken[i, j] * im
        for j in range(cols):
            counts[i, j] = photons[i, j] * used[i, j]


def prepare(work, sums, photons, equaliser, used, taken=None, passed=None, mean=None):
    rows, cols = photons.shape
    if taken is None:
        taken, passed, mean = NOTHING
    equaliser, passed = (np.broadcast_to(each, sums.shape) for each in (equaliser, passed))
    _prepare(sums, photons, equaliser, used, taken, passed, mean,
             maps.crop(work.matched, rows, cols), maps.crop(work.counts, rows, cols))
    return work.matched, work.counts


@each_row
def _residual(i, frame: Frame, state: floats4d, terms: floats4d, layer: int64, rest: floats3d):
    m = len(frame.energy)
    for j in columns(state):
        for l in range(m):
            re, im = load(frame.matched, i, l, j), load(frame.matched, i, m + l, j)
            for k in range(state.shape[1]):
                point = point_at(state, i, k, j)
                there = point.intensity > ZERO
                if k != layer and lanes_of(there):
                    signal = where(there, max(load(terms, i, k, VALUE, j), ZERO) / frame.total_energy, ZERO)
                    re, im = without(re, im, l, signal, point.depth, frame)
            store(rest, i, l, j, re)
            store(rest, i, m + l, j, im)


def residual(work, frame, state, terms, layer):
    _residual(frame, state, terms, layer, work.residual)
    return work.residual


TURN = F32(2 * np.pi)


@inline
def others_removed(i, k, j, l, frame, depth, intensity):
    """Re and Im of z'_l of the surfaces k of the pixels (i, j …); depths and intensities are [rows', K, cols']."""
    re, im = load(frame.matched, i, l, j), load(frame.matched, i, len(frame.energy) + l, j)
    for o in range(depth.shape[1]):
        if o != k:
            signal = load(intensity, i, o, j) * load(frame.exposure, i, j)
            if lanes_of(signal > ZERO):
                re, im = without(re, im, l, signal, load(depth, i, o, j), frame)
    sine, cosine = sincos(frame.bin_frequencies[l] * load(depth, i, k, j))
    return fma(re, cosine, im * sine), fma(-re, sine, im * cosine)


@line
def _data_term(i, k, j, frame, state):
    """v, s and b."""
    v = s = b = full(ZERO)
    for l in range(len(frame.energy)):
        omega = TURN * frame.bin_frequencies[l]
        re, im = others_removed(i, k, j, l, frame, state[:, :, DEPTH], state[:, :, INTENSITY])
        v, s, b = v + re, fma(im, omega, s), fma(re, omega * omega, b)
    return v, s, b


@each_row
def expand_stale(i, frame: Frame, state: floats4d, stale: boolean[:, ::1], terms: floats4d):
    """Write the terms of the vectors of pixels that are `stale`, [rows', cols' // LANES]."""
    for j in columns(state):
        if stale[i, j // LANES]:
            for k in range(state.shape[1]):
                seen, v, s, b = load(state, i, k, INTENSITY, j) > ZERO, full(ZERO), full(ZERO), full(ZERO)
                if lanes_of(seen):
                    v, s, b = _data_term(i, k, j, frame, state)
                counts = load(frame.counts, i, j)
                put(terms, i, k, j, where(seen, Terms(v, s, b, counts, counts, load(frame.exposure, i, j)), ZERO))


def expand(work, frame, state):
    work.stale[:] = True
    expand_stale(frame, state, work.stale, work.terms)
    return work.terms
