"""The end of a frame: final intensity and standard deviation of each point, and the background.

With own = R(z, t) / (g E), its variance by photon noise v and the local mean square s² of own − r, a point gets
r + (own − r) (1 − v / s²)₊ and √(std² + max(residual², τ²)) if score / c(t) is enough. τ² is Σ d / Σ (g r)² with
d = gradient² / C² − (V / C² − (g r std)²)₊, over the window of WIDE_SCALE if Σ d is significant there, else over all
other points, if it is there. The photons that the points leave are n − g Σ_k r_k; g times their local mean over that of
g is the background. `kernels.torch` says why.
"""

import numpy as np
from numba import float32, float64, get_num_threads, get_thread_id, int64, prange, uint8, uint16

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import LOCAL_SIGMA, RELIEF_SCORE, WIDE_SCALE
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, ONE, TINY, TWO, ZERO
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
from srt3d_ros.kernels.cpu.method.frame import Frame, columns, point_at
from srt3d_ros.kernels.cpu.method.likelihood import noise_at
from srt3d_ros.kernels.cpu.method.windows import blur_row
from srt3d_ros.kernels.cpu.vectors import full, load, sqrt, store, where
from srt3d_ros.kernels.maps import DEPTH, GRADIENT, INTENSITY, LANES, MARGIN, SCORE, STD, VALUE

RELIEF_SCORE = F32(RELIEF_SCORE)


def drop_weak(state, enough):
    state[:, :, INTENSITY][state[:, :, SCORE] < enough] = 0


@inline
def _excess(i, k, j, frame, intensity, terms):
    """own − r, and E g."""
    gain = frame.total_energy * max(load(frame.exposure, i, j), EPSILON)
    return load(terms, i, k, VALUE, j) / gain - intensity, gain


@line
def _compare_row(i, frame, state, terms, compared):
    """Write (own − r)² and v of each surface, of which s² and the mean of v are made; 0 without a surface."""
    of_signal, of_background = frame.intensity_moments[0], frame.intensity_moments[1]
    for j in columns(state):
        for k in range(state.shape[1]):
            intensity = load(state, i, k, INTENSITY, j)
            excess, gain = _excess(i, k, j, frame, intensity, terms)
            signal, there = intensity * max(load(frame.exposure, i, j), EPSILON), intensity > ZERO
            variance = signal * of_signal + max(load(frame.counts, i, j) - signal, ZERO) * of_background
            store(compared, i, 2 * k, j, where(there, excess * excess, ZERO))
            store(compared, i, 2 * k + 1, j, where(there, variance / (gain * gain), ZERO))


@line
def _decide_row(i, frame, state, terms, enough, means, points, left, rest, relief):
    """Write the points but for their std, d, (g r)², d², and the photons left; `rest` has all photons before."""
    of_signal, of_background = frame.moments[0], frame.moments[1]
    for j in columns(state):
        light, unexplained = load(frame.exposure, i, j), load(rest, i, j)
        for k in range(state.shape[1]):
            point = point_at(state, i, k, j)
            pooled, (excess, _) = point.intensity, _excess(i, k, j, frame, point.intensity, terms)
            differ = ONE - min(load(means, 2 * k + 1, j) / max(load(means, 2 * k, j), TINY), ONE)
            stays = (pooled > ZERO) & (point.score / noise_at(frame, point.depth) > enough)
            intensity = where(stays, max(pooled + excess * differ, EPSILON * pooled), ZERO)
            signal, slope = intensity * light, load(terms, i, k, GRADIENT, j) / frame.curvature
            variance = signal * of_signal + (load(frame.counts, i, j) - signal) * of_background
            shared = signal * point.std
            noise = max(variance / (frame.curvature * frame.curvature) - shared * shared, ZERO)
            differs = where(stays, slope * slope - noise, ZERO)
            unexplained -= signal
            store(points, i, k, DEPTH, j, point.depth)
            store(points, i, k, INTENSITY, j, intensity)
            store(relief, i, 3 * k, j, differs)
            store(relief, i, 3 * k + 1, j, signal * signal)
            store(relief, i, 3 * k + 2, j, differs * differs)
        store(rest, i, j, max(unexplained, ZERO))
        store(left, i, 0, j, where(light > ZERO, unexplained, ZERO))
        store(left, i, 1, j, light + EPSILON)


@inline
def _tau2(differs, gives, squares, weight):
    """τ², 0 if chance may be its cause; `weight` is Σ w / Σ w² of the window."""
    shown = differs > RELIEF_SCORE * sqrt(squares / weight)
    return where(shown, differs / max(gives, TINY), ZERO)


@line
def _relief_row(i, relief, means, tau2, rest):
    """Write τ² of the windows around points, and sums over those where that is 0, of LANES columns each."""
    differs, gives, squares = full(ZERO), full(ZERO), full(ZERO)
    for k in range(relief.shape[1] // 3):
        for j in columns(relief):
            around = _tau2(load(means, 3 * k, j), load(means, 3 * k + 1, j), load(means, 3 * k + 2, j), TWO)
            store(tau2, i, k, j, around)
            differs += where(around > ZERO, ZERO, load(relief, i, 3 * k, j))
            gives += where(around > ZERO, ZERO, load(relief, i, 3 * k + 1, j))
            squares += where(around > ZERO, ZERO, load(relief, i, 3 * k + 2, j))
    store(rest, i, 0, 0, differs)
    store(rest, i, 1, 0, gives)
    store(rest, i, 2, 0, squares)


@line
def _whole(rest):
    """τ² of all points that windows show none of."""
    differs, gives, squares = ZERO, ZERO, ZERO
    for i in range(MARGIN, len(rest) - MARGIN):
        for lane in range(LANES):
            differs += rest[i, 0, lane]
            gives += rest[i, 1, lane]
            squares += rest[i, 2, lane]
    return differs / max(gives, TINY) if differs > RELIEF_SCORE * sqrt(squares) else ZERO


@line
def _std_row(i, frame, state, tau2, whole, points):
    """Write √(std² + max(residual², τ²))."""
    for j in columns(state):
        for k in range(state.shape[1]):
            point, around = point_at(state, i, k, j), load(tau2, i, k, j)
            relief = max(point.residual * point.residual, where(around > ZERO, around, whole))
            std = sqrt(point.std * point.std + relief)
            store(points, i, k, STD, j, min(max(std, EPSILON), frame.period))


@parallel
def _finalise(frame: Frame, state: floats4d, terms: floats4d, enough: float32, weights: floats1d, wide: floats1d,
              compared: floats3d, means: floats3d, left: floats3d, points: floats4d, rest: floats2d, relief: floats3d,
              smooth: floats3d):
    for i in prange(MARGIN, len(state) - MARGIN):
        _compare_row(i, frame, state, terms, compared)
    for i in prange(MARGIN, len(state) - MARGIN):
        own = means[get_thread_id()]
        blur_row(compared, i, weights, own[-1], own[-2], own)
        _decide_row(i, frame, state, terms, enough, own, points, left, rest, relief)
    for i in prange(MARGIN, len(state) - MARGIN):
        own = means[get_thread_id()]
        blur_row(relief, i, wide, own[-1], own[-2], own)
        _relief_row(i, relief, own, compared, smooth)
    whole = _whole(smooth)
    for i in prange(MARGIN, len(state) - MARGIN):
        _std_row(i, frame, state, compared, whole, points)


@each_row
def _background(i, exposure: floats2d, weights: floats1d, left: floats3d, means: floats3d, background: floats2d):
    """Write g times the mean of the photons left over that of g; masked pixels keep what they have."""
    own = means[get_thread_id()]
    blur_row(left, i, weights, own[-1], own[-2], own)
    for j in columns(exposure):
        light = load(exposure, i, j)
        rate = max(load(own, 0, j) / load(own, 1, j), ZERO)
        store(background, i, j, where(light > ZERO, rate * light, load(background, i, j)))


def finalise(work, frame, photons, state, terms, enough):
    points, rest, background = work.other_state(state), work.rest, work.background
    inner, weights, wide = maps.crop(rest, *frame.shape), *map(maps.window_weights, (LOCAL_SIGMA, WIDE_SCALE))
    inner[:] = photons
    _finalise(frame, state, terms, F32(enough), weights, wide, work.compared, work.means, work.left, points, rest,
              work.relief, work.smooth)
    background[:] = rest
    _background(frame.exposure, weights, work.left, work.means, background)
    return points, inner.copy(), maps.crop(background, *frame.shape).copy()


def background(left, exposure):
    padded = maps.pad(left.clip(min=0))
    means = np.zeros((get_num_threads(), 4, padded.shape[1]), np.float32)
    seen = np.stack([left * (exposure > 0), exposure + EPSILON], axis=2)
    _background(maps.pad(exposure), maps.window_weights(LOCAL_SIGMA), maps.pad(seen), means, padded)
    return maps.crop(padded, *left.shape).copy()


def local_mean(values, used):
    return background(values * used, used)


MAP, RAYS = read_only(float32[:, :, :]), read_only(floats3d)


@line
def _rank(intensity, i, k, j):
    """How many surfaces of the pixel come before surface k: the stronger ones, of equals those with a lower index."""
    rank = 0
    for other in range(intensity.shape[1]):
        more = intensity[i, other, j] - intensity[i, k, j]
        rank += more > ZERO or (more == ZERO and other < k)
    return rank


@parallel
def _collect(depth: MAP, intensity: MAP, std: MAP, rays: RAYS, first: int64[::1], scale: float64[::1], row: uint16[::1],
             col: uint16[::1], rank: uint8[::1], values: floats2d, xyz: floats2d):
    """Write the points of each row of pixels from place `first` on; `scale` is metres_per_bin, metres, num_bins."""
    for i in prange(len(intensity)):
        place = first[i]
        for j in range(intensity.shape[2]):
            number = 0
            for k in range(intensity.shape[1]):
                if intensity[i, k, j] > ZERO:
                    at, number = place + _rank(intensity, i, k, j), number + 1
                    t = depth[i, k, j] if depth[i, k, j] < scale[2] else ZERO       # rounded up to T
                    row[at], col[at], rank[at] = i, j, at - place
                    values[0, at], values[1, at], values[2, at] = t, intensity[i, k, j], std[i, k, j]
                    for axis in range(3):
                        xyz[at, axis] = rays[i, j, axis] * (t * scale[0] + scale[1])
            place += number


def collect(depth, intensity, std, rays, metres_per_bin, metres, num_bins):
    of_rows = np.count_nonzero(intensity > 0, axis=(1, 2))
    ends = np.cumsum(of_rows)
    row, col, rank = (np.empty(ends[-1], kind) for kind in (np.uint16, np.uint16, np.uint8))
    values, xyz = np.empty((3, ends[-1]), np.float32), np.empty((ends[-1], 3), np.float32)
    _collect(depth, intensity, std, rays, ends - of_rows, np.array([metres_per_bin, metres, num_bins], float), row, col,
             rank, values, xyz)
    return row, col, rank, values, xyz
