"""The end of a frame: final intensity and standard deviation of each point, and the background.

With own = R(z, t) / (g E), its variance by photon noise v and the local mean square s² of own − r, a point gets
r + (own − r) (1 − v / s²)₊ and √(std² + residual²) if score / c(t) is enough. The photons that the points leave are
n − g Σ_k r_k; g times their local mean over that of g is the background. `kernels.torch` says why.
"""

import numpy as np
from numba import float32, get_num_threads, get_thread_id, prange

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import LOCAL_SIGMA
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, ONE, TINY, ZERO
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel
from srt3d_ros.kernels.cpu.method.blur import blur, blur_row
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.cpu.method.likelihood import noise_at
from srt3d_ros.kernels.cpu.vectors import load, sqrt, store, where
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, LANES, MARGIN, RESIDUAL, SCORE, STD, VALUE


@parallel
def _drop_weak(state: float32[:, :, :, ::1], enough: float32):
    for i in prange(len(state)):
        for k in range(state.shape[1]):
            for j in range(0, state.shape[3], LANES):
                keeps = load(state, i, k, SCORE, j) >= enough
                store(state, i, k, INTENSITY, j, where(keeps, load(state, i, k, INTENSITY, j), ZERO))


def drop_weak(state, enough):
    _drop_weak(state, F32(enough))


@inline
def _excess(i, k, j, frame, state, terms):
    """own − r, and E g."""
    gain = frame.total_energy * max(load(frame.exposure, i, j), EPSILON)
    return load(terms, i, k, VALUE, j) / gain - load(state, i, k, INTENSITY, j), gain


@line
def _compare_row(i, frame, state, terms, compared):
    """Write (own − r)² and v of each surface, of which s² and the mean of v are made; 0 without a surface."""
    of_signal, of_background = frame.intensity_moments[0], frame.intensity_moments[1]
    for j in range(MARGIN, state.shape[3] - MARGIN, LANES):
        for k in range(state.shape[1]):
            there = load(state, i, k, INTENSITY, j) > ZERO
            excess, gain = _excess(i, k, j, frame, state, terms)
            signal = load(state, i, k, INTENSITY, j) * max(load(frame.exposure, i, j), EPSILON)
            variance = signal * of_signal + max(load(frame.counts, i, j) - signal, ZERO) * of_background
            store(compared, i, 2 * k, j, where(there, excess * excess, ZERO))
            store(compared, i, 2 * k + 1, j, where(there, variance / (gain * gain), ZERO))


@line
def _decide_row(i, frame, state, terms, enough, means, points, left, rest):
    """Write the points and the photons that they leave; `rest` has all photons before."""
    for j in range(MARGIN, state.shape[3] - MARGIN, LANES):
        light, unexplained = load(frame.exposure, i, j), load(rest, i, j)
        for k in range(state.shape[1]):
            pooled, depth = load(state, i, k, INTENSITY, j), load(state, i, k, DEPTH, j)
            std, residual = load(state, i, k, STD, j), load(state, i, k, RESIDUAL, j)
            excess, _ = _excess(i, k, j, frame, state, terms)
            differ = ONE - min(load(means, 2 * k + 1, j) / max(load(means, 2 * k, j), TINY), ONE)
            stays = (pooled > ZERO) & (load(state, i, k, SCORE, j) / noise_at(frame, depth) > enough)
            intensity = where(stays, max(pooled + excess * differ, EPSILON * pooled), ZERO)
            unexplained -= intensity * light
            store(points, i, k, DEPTH, j, depth)
            store(points, i, k, INTENSITY, j, intensity)
            store(points, i, k, STD, j, min(max(sqrt(std * std + residual * residual), EPSILON), frame.period))
        store(rest, i, j, max(unexplained, ZERO))
        store(left, i, 0, j, where(light > ZERO, unexplained, ZERO))
        store(left, i, 1, j, light + EPSILON)


@line
def _spread_row(i, exposure, means, background):
    """Write g times the mean of the photons left over that of g; masked pixels keep what they have."""
    for j in range(MARGIN, exposure.shape[1] - MARGIN, LANES):
        light = load(exposure, i, j)
        rate = max(load(means, 0, j) / load(means, 1, j), ZERO)
        store(background, i, j, where(light > ZERO, rate * light, load(background, i, j)))


@parallel
def _finalise(frame: Frame, state: float32[:, :, :, ::1], terms: float32[:, :, :, ::1], enough: float32,
              weights: float32[::1], compared: float32[:, :, ::1], means: float32[:, :, ::1], left: float32[:, :, ::1],
              points: float32[:, :, :, ::1], rest: float32[:, ::1]):
    for turn in prange(len(state) - 2 * MARGIN):
        _compare_row(turn + MARGIN, frame, state, terms, compared)
    for turn in prange(len(state) - 2 * MARGIN):
        own = means[get_thread_id()]
        blur_row(compared, turn + MARGIN, weights, own[-1], own[-2], own)
        _decide_row(turn + MARGIN, frame, state, terms, enough, own, points, left, rest)


@parallel
def _background(exposure: float32[:, ::1], weights: float32[::1], left: float32[:, :, ::1], means: float32[:, :, ::1],
                background: float32[:, ::1]):
    for turn in prange(len(exposure) - 2 * MARGIN):
        own = means[get_thread_id()]
        blur_row(left, turn + MARGIN, weights, own[-1], own[-2], own)
        _spread_row(turn + MARGIN, exposure, own, background)


def finalise(work, frame, photons, state, terms, enough):
    points, rest, background = work.other_state(state), work.rest, work.background
    inner, weights = maps.crop(rest, *frame.shape), maps.window_weights(LOCAL_SIGMA)
    inner[:] = photons
    _finalise(frame, state, terms, F32(enough), weights, work.compared, work.means, work.left, points, rest)
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
    sums = blur(np.stack([values * used, used + EPSILON], axis=1), LOCAL_SIGMA)
    return sums[:, 0] / sums[:, 1] * used
