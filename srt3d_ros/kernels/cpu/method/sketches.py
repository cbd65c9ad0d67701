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
from numba import complex64, float32, int64, prange

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import EPSILON, LOCAL_SIGMA, TINY
from srt3d_ros.kernels.cpu.arithmetic import F32, sincos
from srt3d_ros.kernels.cpu.compiling import each, floats1d, floats2d, floats3d, floats4d, inline, parallel, read_only
from srt3d_ros.kernels.cpu.method.frame import Frame, point_at, without
from srt3d_ros.kernels.cpu.method.likelihood import by_bin
from srt3d_ros.kernels.cpu.method.windows import across, sum_down
from srt3d_ros.kernels.cpu.spans import columns, first_of
from srt3d_ros.kernels.cpu.vectors import fma, full, lane_numbers, lanes_of, total, where
from srt3d_ros.kernels.maps import DEPTH, GRADIENT, INTENSITY, MARGIN, TERMS, VALUE

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
    matched, counts = work.map("matched", 2 * sums.shape[2]), work.map("counts")
    if taken is None:
        taken, passed, mean = NOTHING
    equaliser, passed = (np.broadcast_to(values, sums.shape) for values in (equaliser, passed))
    _prepare(sums, photons, equaliser, used, taken, passed, mean, maps.crop(matched, *work.shape),
             maps.crop(counts, *work.shape))
    return matched, counts


@each
def _residual(i, j, frame: Frame, state: floats4d, terms: floats4d, layer: int64, rest: floats3d):
    m = len(frame.energy)
    for l in range(m):
        re, im = frame.matched[i, l, j], frame.matched[i, m + l, j]
        for k in range(state.shape[1]):
            point = point_at(state, i, k, j)
            there = point.intensity > 0
            if k != layer and lanes_of(there):
                signal = where(there, max(terms[i, k, VALUE, j], 0) / frame.total_energy, 0)
                re, im = without(re, im, l, signal, point.depth, frame)
        rest[i, l, j], rest[i, m + l, j] = re, im


def residual(work, frame, state, terms, layer):
    rest = work.map("residual", frame.matched.shape[1])
    _residual(frame, state, terms, layer, rest)
    return rest


TURN = F32(2 * np.pi)


@inline
def others_removed(i, k, j, l, frame, depth, intensity):
    """Re and Im of z'_l of the surfaces k of the pixels (i, j); depths and intensities are [rows', K, cols']."""
    re, im = frame.matched[i, l, j], frame.matched[i, len(frame.energy) + l, j]
    for o in range(depth.shape[1]):
        if o != k:
            signal = intensity[i, o, j] * frame.exposure[i, j]
            if lanes_of(signal > 0):
                re, im = without(re, im, l, signal, depth[i, o, j], frame)
    sine, cosine = sincos(frame.bin_frequencies[l] * depth[i, k, j])
    return fma(re, cosine, im * sine), fma(-re, sine, im * cosine)


@each
def expand_stale(i, j, frame: Frame, state: floats4d, terms: floats4d, stale: floats2d):
    """Write the terms of the pixels that are `stale`."""
    if lanes_of(stale[i, j] > 0):
        for k in range(state.shape[1]):
            seen, v, s, b = state[i, k, INTENSITY, j] > 0, full(0.0), full(0.0), full(0.0)
            for l in range(len(frame.energy) if lanes_of(seen) else 0):
                omega = TURN * frame.bin_frequencies[l]
                re, im = others_removed(i, k, j, l, frame, state[:, :, DEPTH], state[:, :, INTENSITY])
                v, s, b = v + re, fma(im, omega, s), fma(re, omega * omega, b)
            counts = frame.counts[i, j]
            for term, value in enumerate((v, s, b, counts, counts, frame.exposure[i, j])):
                terms[i, k, term, j] = where(seen, value, 0)


def expand(work, frame, state):
    terms, stale = work.map("terms", work.surfaces, TERMS), work.map("stale")
    stale[:] = 1
    expand_stale(frame, state, terms, stale)
    return terms


@inline
def _solved(a, b, c, p, q):
    """X, Y of (1 + c) X + q Y = a, q X + (1 − p) Y = b."""
    det = (1 + c) * (1 - p) - q * q
    return ((1 - p) * a - q * b) / det, ((1 + c) * b - q * a) / det


@each
def _solve_pairs(i, j, frame: Frame, state: floats4d, terms: floats4d):
    width, energy = frame.resolution, frame.exposure[i, j] * frame.total_energy
    for other in range(1, state.shape[1]):
        for own in range(other):
            one, two = state[i, own, INTENSITY, j] * energy, state[i, other, INTENSITY, j] * energy
            both, apart = (one > 0) & (two > 0), state[i, other, DEPTH, j] - state[i, own, DEPTH, j]
            if lanes_of(both):
                c, p, q = (by_bin(frame.overlap[0], apart), by_bin(frame.overlap[1], apart),
                           by_bin(frame.overlap[2], apart))
                v, u = terms[i, own, VALUE, j], terms[i, other, VALUE, j]
                s, t = terms[i, own, GRADIENT, j], terms[i, other, GRADIENT, j]
                alike, parted = _solved(v - one + (u - two), (s - t) * width, c, p, q)
                unlike, together = _solved(v - one - (u - two), (s + t) * width, -c, -p, -q)
                terms[i, own, VALUE, j] = where(both, one + (alike + unlike) / 2, v)
                terms[i, other, VALUE, j] = where(both, two + (alike - unlike) / 2, u)
                terms[i, own, GRADIENT, j] = where(both, (together + parted) / (2 * width), s)
                terms[i, other, GRADIENT, j] = where(both, (together - parted) / (2 * width), t)


def solve_pairs(work, frame, state, terms):
    if state.shape[1] > 1:
        _solve_pairs(frame, state, terms)


OWN, PHOTONS, USED = range(3)       # of `values` and `summed`: own, n, 1 in used pixels
SHARE, INVERSE = range(2)           # of `weights`: w, 1 / n̄


@each
def _see(i, j, frame: Frame, rest: floats2d, values: floats3d):
    """Write what is averaged around pixels."""
    used = where(frame.exposure[i, j] > 0, 1.0, 0)
    values[i, OWN, j], values[i, PHOTONS, j], values[i, USED, j] = rest[i, j] * used, frame.counts[i, j], used + EPSILON


@inline
def _shown_at(i, j, l, frame, points):
    """Re y_l and Im y_l."""
    re = im = full(0.0)
    for k in range(points.shape[1]):
        point = point_at(points, i, k, j)
        signal = point.intensity * frame.exposure[i, j]
        if lanes_of(signal > 0):
            sine, cosine = sincos(frame.bin_frequencies[l] * point.depth)
            re, im = fma(signal, cosine, re), fma(signal, sine, im)
    return re, im


@each
def _sum_row(i, frame: Frame, points: floats4d, taken: floats2d, passed: floats3d, window: floats1d, values: floats3d,
             summed: floats3d, weights: floats3d, sums: floats2d, rest: floats2d):
    m, last, out = len(frame.energy), passed.shape[1] - 1, sums[i - MARGIN]
    own = given = counts = misfit = full(0.0)
    for j in columns(rest):
        used = frame.exposure[i, j] > 0
        used_around = across(summed, i, USED, j, window)
        around = max(where(used, across(summed, i, PHOTONS, j, window) / used_around, 0), EPSILON)
        w = where(used, across(summed, i, OWN, j, window) / used_around, 0) / around
        own, given = fma(w, values[i, OWN, j], own), fma(w, taken[i, j], given)
        counts = fma(w * w, frame.counts[i, j], counts)
        weights[i, SHARE, j], weights[i, INVERSE, j] = w, 1 / around
    for l in range(m):
        energy, left_re, left_im, shown_re, shown_im = frame.energy[l], full(0.0), full(0.0), full(0.0), full(0.0)
        for j in columns(rest):
            w, inverse = weights[i, SHARE, j], weights[i, INVERSE, j]
            y_re, y_im = _shown_at(i, j, l, frame, points)
            re, im = frame.matched[i, l, j] - energy * y_re, frame.matched[i, m + l, j] - energy * y_im
            row, cols = min(i - MARGIN, len(passed) - 1), min(lane_numbers() + (first_of(j) - MARGIN), last)
            q_re, q_im = full(passed[row, 0, 2 * l]), full(passed[row, 0, 2 * l + 1])
            if last > 0:
                q_re, q_im = passed[row, cols, 2 * l], passed[row, cols, 2 * l + 1]
            left_re, left_im = left_re + w * (re * q_re + im * q_im), left_im + w * (im * q_re - re * q_im)
            shown_re, shown_im = fma(w, y_re, shown_re), fma(w, y_im, shown_im)
            misfit += (re * re + im * im) * inverse / max(energy, TINY)
        for part, lanes in enumerate((left_re, left_im, shown_re, shown_im)):
            out[part * m + l] = total(lanes)
    for part, lanes in enumerate((own, given, counts, misfit)):
        out[4 * m + part] = total(lanes)


def unexplained(work, frame, points, rest, taken, passed):
    inner, inner_taken, window = work.map("rest"), work.map("taken"), maps.window_weights(LOCAL_SIGMA)
    maps.crop(inner, *work.shape)[:], maps.crop(inner_taken, *work.shape)[:] = rest, rest if taken is None else taken
    values, sums = work.map("averaged", 3), work.array("row sums", work.shape[0], 4 * len(frame.energy) + 4)
    _see(frame, inner, values)
    _sum_row(frame, points, inner_taken, passed.view(np.float32), window, values, sum_down(work, values, window),
             work.map("weights", 2), sums, inner)
    return sums.sum(axis=0, dtype=np.float64).astype(np.float32)
