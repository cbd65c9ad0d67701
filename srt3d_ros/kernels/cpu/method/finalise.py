"""The end of a frame: final intensity and standard deviation of each point, and the background.

With own = R(z, t) / (g E), its variance by photon noise v and the local mean square s² of own − r, a point gets
r + (own − r) (1 − v / s²)₊ and √(std² + max(residual², min(τ², V / (g r C)²))) if score / c(t) is enough. With
d = (gradient / C − g r off)² − (V / C² − (g r std)²)₊, where the points beside it are `off` its plane, τ² is
D / Σ (g r)² of the window of WIDE_SCALE if D = Σ d is significant there, else (D − Σ d² / D)₊ / Σ (g r)² of all other
points. The photons that the points leave are n − g Σ_k r_k; g times their local mean over that of g is the background.
`kernels.torch` says why.
"""

import numpy as np
from numba import float32, float64, get_num_threads, get_thread_id, int64, prange, uint8, uint16

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import LOCAL_SIGMA, RELIEF_SCORE, SAME_SURFACE, WIDE_SCALE
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, ONE, TINY, ZERO, wrap
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

# Of windows; √2, because Σ w² is half Σ w of a Gaussian
RELIEF_SCORE = F32(RELIEF_SCORE / 2**0.5)
SAME = F32(SAME_SURFACE**2)


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


@inline
def _off(state, i, k, j, point, most, frame):
    """Mean distance of the points beside, above and below from a point's plane, bins, of squares below `most`."""
    total, number = full(ZERO), full(ZERO)
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            if abs(dx) + abs(dy) == 1:
                plane = point.depth + F32(dx) * point.slope_col + F32(dy) * point.slope_row
                e = wrap(load(state, i + dy, k, DEPTH, j + dx) - plane, frame.period)
                near = (load(state, i + dy, k, INTENSITY, j + dx) > ZERO) & (e * e < most)
                total, number = total + where(near, e, ZERO), number + where(near, ONE, ZERO)
    return total / max(number, ONE)


@inline
def _noise(signal, counts, frame):
    """V / C², the variance of gradient / C by photon noise."""
    variance = signal * frame.moments[0] + (counts - signal) * frame.moments[1]
    return variance / (frame.curvature * frame.curvature)


@inline
def _alone(signal, counts, frame):
    """V / (g r C)², the variance of a depth by a pixel's own photons, those of the surface at least."""
    return _noise(signal, max(counts, signal), frame) / max(signal * signal, TINY)


@line
def _decide_row(i, frame, state, terms, enough, means, points, left, rest, relief):
    """Write the points but for their std, d, (g r)², d², and the photons left; `rest` has all photons before."""
    for j in columns(state):
        light, unexplained = load(frame.exposure, i, j), load(rest, i, j)
        for k in range(state.shape[1]):
            point = point_at(state, i, k, j)
            pooled, (excess, _) = point.intensity, _excess(i, k, j, frame, point.intensity, terms)
            differ = ONE - min(load(means, 2 * k + 1, j) / max(load(means, 2 * k, j), TINY), ONE)
            stays = (pooled > ZERO) & (point.score / noise_at(frame, point.depth) > enough)
            intensity = where(stays, max(pooled + excess * differ, EPSILON * pooled), ZERO)
            signal, counts, shared = intensity * light, load(frame.counts, i, j), intensity * light * point.std
            most = min(SAME * _alone(signal, counts, frame), frame.resolution * frame.resolution)
            own = load(terms, i, k, GRADIENT, j) / frame.curvature - signal * _off(state, i, k, j, point, most, frame)
            noise = max(_noise(signal, counts, frame) - shared * shared, ZERO)
            differs = where(stays, own * own - noise, ZERO)
            unexplained -= signal
            store(points, i, k, DEPTH, j, point.depth)
            store(points, i, k, INTENSITY, j, intensity)
            store(relief, i, 3 * k, j, differs)
            store(relief, i, 3 * k + 1, j, signal * signal)
            store(relief, i, 3 * k + 2, j, differs * differs)
        store(rest, i, j, max(unexplained, ZERO))
        store(left, i, 0, j, where(light > ZERO, unexplained, ZERO))
        store(left, i, 1, j, light + EPSILON)


@line
def _relief_row(i, relief, means, tau2, rest):
    """Write τ² of the windows around points, and sums over the others, of LANES columns each."""
    differs, gives, squares = full(ZERO), full(ZERO), full(ZERO)
    for k in range(relief.shape[1] // 3):
        for j in columns(relief):
            around = load(means, 3 * k, j)
            shown = around > RELIEF_SCORE * sqrt(load(means, 3 * k + 2, j))
            store(tau2, i, k, j, where(shown, around / max(load(means, 3 * k + 1, j), TINY), ZERO))
            differs += where(shown, ZERO, load(relief, i, 3 * k, j))
            gives += where(shown, ZERO, load(relief, i, 3 * k + 1, j))
            squares += where(shown, ZERO, load(relief, i, 3 * k + 2, j))
    store(rest, i, 0, 0, differs)
    store(rest, i, 1, 0, gives)
    store(rest, i, 2, 0, squares)


@line
def _whole(rest):
    """τ² of all points whose windows show none."""
    differs, gives, squares = ZERO, ZERO, ZERO
    for i in range(MARGIN, len(rest) - MARGIN):
        for lane in range(LANES):
            differs += rest[i, 0, lane]
            gives += rest[i, 1, lane]
            squares += rest[i, 2, lane]
    return max(differs - squares / max(differs, TINY), ZERO) / max(gives, TINY)


@line
def _std_row(i, frame, state, tau2, whole, points):
    """Write √(std² + max(residual², min(τ², V / (g r C)²)))."""
    for j in columns(state):
        light, counts = load(frame.exposure, i, j), load(frame.counts, i, j)
        for k in range(state.shape[1]):
            point, around = point_at(state, i, k, j), load(tau2, i, k, j)
            signal = load(points, i, k, INTENSITY, j) * light
            relief = min(where(around > ZERO, around, whole), _alone(signal, counts, frame))
            std = sqrt(point.std * point.std + max(point.residual * point.residual, relief))
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
