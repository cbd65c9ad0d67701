"""Data term of every point to second order, f(t + d) ≈ v + s d − b d² / 2, in what the other surfaces leave of a pixel:

    z'_l = (z_l − g Σ_{o ≠ k} r_o |ĥ_l|² exp(i ω_l t_o)) exp(−i ω_l t_k)
    v = Σ Re z'_l,  s = Σ ω_l Im z'_l,  b = Σ ω_l² Re z'_l
"""

import numpy as np
from numba import boolean, float32, prange

from srt3d_ros.kernels.cpu.arithmetic import F32, ZERO, sincos
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.cpu.vectors import fma, full, lanes_of, load, store, where
from srt3d_ros.kernels.maps import (
    COUNTS,
    CURVATURE,
    DEPTH,
    EXPOSURE,
    GRADIENT,
    INTENSITY,
    LANES,
    MARGIN,
    SQUARES,
    VALUE,
)

TURN = F32(2 * np.pi)


@inline
def others_removed(i, k, j, l, frame, depth, intensity):
    """Re and Im of z'_l of the surfaces k of the pixels (i, j …); depths and intensities are [rows', K, cols']."""
    frequency, exposure = frame.bin_frequencies[l], load(frame.exposure, i, j)
    re, im = load(frame.matched, i, l, j), load(frame.matched, i, len(frame.energy) + l, j)
    for o in range(depth.shape[1]):
        if o != k:
            gives = load(intensity, i, o, j) * exposure * frame.energy[l]
            if lanes_of(gives > ZERO):
                sine, cosine = sincos(frequency * load(depth, i, o, j))
                re, im = re - gives * cosine, im - gives * sine
    sine, cosine = sincos(frequency * load(depth, i, k, j))
    return fma(re, cosine, im * sine), fma(-re, sine, im * cosine)


@line
def _data_term(i, k, j, frame, depth, intensity):
    """v, s and b."""
    v = s = b = full(ZERO)
    for l in range(len(frame.energy)):
        omega, (re, im) = TURN * frame.bin_frequencies[l], others_removed(i, k, j, l, frame, depth, intensity)
        v, s, b = v + re, fma(im, omega, s), fma(re, omega * omega, b)
    return v, s, b


@line
def _expand_row(i, frame, state, terms, stale):
    for j in range(MARGIN, state.shape[3] - MARGIN, LANES):
        if not stale[i, j // LANES]:
            continue
        for k in range(state.shape[1]):
            seen, v, s, b = load(state, i, k, INTENSITY, j) > ZERO, full(ZERO), full(ZERO), full(ZERO)
            if lanes_of(seen):
                v, s, b = _data_term(i, k, j, frame, state[:, :, DEPTH], state[:, :, INTENSITY])
            counts = where(seen, load(frame.counts, i, j), ZERO)
            store(terms, i, k, VALUE, j, where(seen, v, ZERO))
            store(terms, i, k, GRADIENT, j, where(seen, s, ZERO))
            store(terms, i, k, CURVATURE, j, where(seen, b, ZERO))
            store(terms, i, k, SQUARES, j, counts)
            store(terms, i, k, COUNTS, j, counts)
            store(terms, i, k, EXPOSURE, j, where(seen, load(frame.exposure, i, j), ZERO))


@parallel
def expand_stale(frame: Frame, state: float32[:, :, :, ::1], terms: float32[:, :, :, ::1], stale: boolean[:, ::1]):
    """Write the terms of the vectors of pixels that are `stale`, [rows', cols' // LANES]."""
    for turn in prange(len(state) - 2 * MARGIN):
        _expand_row(turn + MARGIN, frame, state, terms, stale)


def expand(work, frame, state):
    work.stale[:] = True
    expand_stale(frame, state, work.terms, work.stale)
    return work.terms
