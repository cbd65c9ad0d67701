"""Matched sketches, what surfaces leave of them, and the data terms of points.

    prepare:   z_l = equaliser_l · sums_l − taken · passed_l β_l
    residual:  z_l − Σ_{k ≠ layer} (v_k / E)₊ |ĥ_l|² exp(i ω_l t_k)
    expand:    f(t + d) ≈ v + s d − b d² / 2 with v = Σ Re z'_l, s = Σ ω_l Im z'_l, b = Σ ω_l² Re z'_l,
               z'_l = (z_l − g Σ_{o ≠ k} r_o |ĥ_l|² exp(i ω_l t_o)) exp(−i ω_l t_k)
    solve_pairs: v and s of a step of two surfaces together; `kernels.torch` has the equations
    unexplained: sums over the pixels of w conj(q_l) (z_l − |ĥ_l|² y_l), of w y_l (real parts before imaginary ones), of
               w · own, w · taken, w² n and Σ_l |z_l − |ĥ_l|² y_l|² / |ĥ_l|² n̄. y_l = g Σ_k r_k exp(i ω_l t_k),
               w = b̄ / n̄, own are the photons of `rest` in used pixels, b̄ and n̄ local means of own and of n. Rows are
               summed in float32, their sums in float64.
"""

import numpy as np
from numba import boolean, complex64, float32, get_thread_id, int64, prange

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import LOCAL_SIGMA
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, HALF, ONE, TINY, ZERO, sincos
from srt3d_ros.kernels.cpu.compiling import (
    each_row,
    floats1d,
    floats2d,
    floats3d,
    floats4d,
    inline,
    line,
    parallel,
    read_only,
)
from srt3d_ros.kernels.cpu.method.frame import Frame, Terms, columns, point_at, put, without
from srt3d_ros.kernels.cpu.method.likelihood import by_bin
from srt3d_ros.kernels.cpu.method.windows import blur_row
from srt3d_ros.kernels.cpu.vectors import fma, full, lane_numbers, lanes_of, load, store, total, where
from srt3d_ros.kernels.maps import DEPTH, GRADIENT, INTENSITY, LANES, MARGIN, VALUE

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


@inline
def _solved(a, b, c, p, q):
    """X, Y of (1 + c) X + q Y = a, q X + (1 − p) Y = b."""
    scale = ONE / ((ONE + c) * (ONE - p) - q * q)
    return ((ONE - p) * a - q * b) * scale, ((ONE + c) * b - q * a) * scale


@each_row
def _solve_pairs(i, frame: Frame, state: floats4d, terms: floats4d):
    width = frame.resolution
    for j in columns(state):
        light = load(frame.exposure, i, j) * frame.total_energy
        for o in range(1, state.shape[1]):
            for k in range(o):
                own, other = light * load(state, i, k, INTENSITY, j), light * load(state, i, o, INTENSITY, j)
                both = (own > ZERO) & (other > ZERO)
                if lanes_of(both) == 0:
                    continue
                distance = load(state, i, o, DEPTH, j) - load(state, i, k, DEPTH, j)
                c, p, q = (by_bin(frame.overlap[0], distance), by_bin(frame.overlap[1], distance),
                           by_bin(frame.overlap[2], distance))
                v_k, v_o = load(terms, i, k, VALUE, j), load(terms, i, o, VALUE, j)
                s_k, s_o = load(terms, i, k, GRADIENT, j), load(terms, i, o, GRADIENT, j)
                alike, apart = _solved(v_k - own + (v_o - other), (s_k - s_o) * width, c, p, q)
                unlike, together = _solved(v_k - own - (v_o - other), (s_k + s_o) * width, -c, -p, -q)
                store(terms, i, k, VALUE, j, where(both, own + HALF * (alike + unlike), v_k))
                store(terms, i, o, VALUE, j, where(both, other + HALF * (alike - unlike), v_o))
                store(terms, i, k, GRADIENT, j, where(both, HALF * (together + apart) / width, s_k))
                store(terms, i, o, GRADIENT, j, where(both, HALF * (together - apart) / width, s_o))


def solve_pairs(work, frame, state, terms):
    if state.shape[1] > 1:
        _solve_pairs(frame, state, terms)


OWN, PHOTONS, USED = range(3)       # of `seen`: own, n, 1 in used pixels


@line
def _see_row(i, frame, rest, seen):
    """Write what is averaged around pixels."""
    for j in columns(rest):
        used = where(load(frame.exposure, i, j) > ZERO, ONE, ZERO)
        store(seen, i, OWN, j, load(rest, i, j) * used)
        store(seen, i, PHOTONS, j, load(frame.counts, i, j))
        store(seen, i, USED, j, used + EPSILON)


@line
def _shown_at(i, j, l, frame, points):
    """Re y_l and Im y_l."""
    re = im = full(ZERO)
    for k in range(points.shape[1]):
        point = point_at(points, i, k, j)
        signal = point.intensity * load(frame.exposure, i, j)
        if lanes_of(signal > ZERO):
            sine, cosine = sincos(frame.bin_frequencies[l] * point.depth)
            re, im = fma(signal, cosine, re), fma(signal, sine, im)
    return re, im


@line
def _sum_row(i, frame, points, seen, taken, passed, means, sums):
    m, last = len(frame.energy), passed.shape[1] - 1
    own = given = counts = misfit = full(ZERO)
    for j in columns(points):
        used = load(frame.exposure, i, j) > ZERO
        around = max(where(used, load(means, PHOTONS, j) / load(means, USED, j), ZERO), EPSILON)
        w = where(used, load(means, OWN, j) / load(means, USED, j), ZERO) / around
        own, given = fma(w, load(seen, i, OWN, j), own), fma(w, load(taken, i, j), given)
        counts = fma(w * w, load(frame.counts, i, j), counts)
        store(means, OWN, j, w)
        store(means, PHOTONS, j, ONE / around)
    for l in range(m):
        energy, left_re, left_im, shown_re, shown_im = frame.energy[l], full(ZERO), full(ZERO), full(ZERO), full(ZERO)
        for j in columns(points):
            w, inverse = load(means, OWN, j), load(means, PHOTONS, j)
            y_re, y_im = _shown_at(i, j, l, frame, points)
            re, im = load(frame.matched, i, l, j) - energy * y_re, load(frame.matched, i, m + l, j) - energy * y_im
            row, cols = min(i - MARGIN, len(passed) - 1), min(lane_numbers() + (j - MARGIN), last)
            q_re, q_im = full(passed[row, 0, 2 * l]), full(passed[row, 0, 2 * l + 1])
            if last > 0:
                q_re, q_im = load(passed, row, cols, 2 * l), load(passed, row, cols, 2 * l + 1)
            left_re, left_im = left_re + w * (re * q_re + im * q_im), left_im + w * (im * q_re - re * q_im)
            shown_re, shown_im = fma(w, y_re, shown_re), fma(w, y_im, shown_im)
            misfit += (re * re + im * im) * inverse / max(energy, TINY)
        sums[l], sums[m + l], sums[2 * m + l], sums[3 * m + l] = (
            total(left_re), total(left_im), total(shown_re), total(shown_im))
    sums[4 * m], sums[4 * m + 1], sums[4 * m + 2], sums[4 * m + 3] = (
        total(own), total(given), total(counts), total(misfit))


@parallel
def _unexplained(frame: Frame, points: floats4d, rest: floats2d, taken: floats2d, passed: floats3d, weights: floats1d,
                 seen: floats3d, means: floats3d, out: floats2d):
    for i in prange(MARGIN, len(rest) - MARGIN):
        _see_row(i, frame, rest, seen)
    for i in prange(MARGIN, len(rest) - MARGIN):
        own = means[get_thread_id()]
        blur_row(seen, i, weights, own[-1], own[-2], own)
        _sum_row(i, frame, points, seen, taken, passed, own, out[i - MARGIN])


def unexplained(work, frame, points, rest, taken, passed):
    shape = frame.shape
    maps.crop(work.rest, *shape)[:] = rest
    maps.crop(work.taken, *shape)[:] = rest if taken is None else taken
    sums = np.empty((shape[0], 4 * len(frame.energy) + 4), np.float32)
    _unexplained(frame, points, work.rest, work.taken, passed.view(np.float32), maps.window_weights(LOCAL_SIGMA),
                 work.seen, work.means, sums)
    return sums.sum(axis=0, dtype=np.float64).astype(np.float32)
