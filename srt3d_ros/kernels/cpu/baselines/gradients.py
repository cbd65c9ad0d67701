"""The baselines' gradient steps, on each pixel's sketch and on the Poisson likelihood of its times of arrival.

`pixelwise`: with d_l = (z_l − g Σ_k r_k |ĥ_l|² exp(i ω_l t_k)) exp(−i ω_l t), rows a of the table give
Δ_rt = a₀ · Re d + a₁ · Im d and Δ_r = a₂ · Re d + a₃ · Im d; t += rate Δ_rt s / max(s, usual g)², at most δ, and
r += INTENSITY_RATE Δ_r / g, at least 0, with s = g max(r, the new r).
"""

import numpy as np
from numba import float32, int64, prange

from srt3d_ros.kernels import constants, maps
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, TINY, ZERO
from srt3d_ros.kernels.cpu.compiling import each, floats1d, floats2d, floats3d, inline, line, parallel
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.cpu.method.sketches import others_removed
from srt3d_ros.kernels.cpu.vectors import floor, full, lanes_of, to_ints, where
from srt3d_ros.kernels.maps import MARGIN

RATE = F32(constants.INTENSITY_RATE)


@inline
def _step_at(table, level, row, l):
    """a of a row of the table, at each pixel's level."""
    return table[level, row, l] if len(table) > 1 else full(table[0, row, l])


@line
def _errors(i, k, j, frame, table, depth, intensity):
    """Δ_rt and Δ_r."""
    gives, last = frame.exposure[i, j] * intensity[i, k, j], len(table) - 1
    level = to_ints(min(gives / max(frame.counts[i, j], 1), 1) * last + 0.5, last)
    shift = change = full(0.0)
    for l in range(len(frame.energy)):
        re, im = others_removed(i, k, j, l, frame, depth, intensity)
        re -= gives * frame.energy[l]
        shift += _step_at(table, level, 0, l) * re + _step_at(table, level, 1, l) * im
        change += _step_at(table, level, 2, l) * re + _step_at(table, level, 3, l) * im
    return shift, change


@each
def _pixelwise(i, j, frame: Frame, table: floats3d, rate: float32, usual: float32, faintest: float32, depth: floats3d,
               intensity: floats3d, new_depth: floats3d, new_intensity: floats3d):
    for k in range(depth.shape[1]):
        t, r = depth[i, k, j], intensity[i, k, j]
        there = r > 0
        if lanes_of(there):
            shift, change = _errors(i, k, j, frame, table, depth, intensity)
            seen = max(frame.exposure[i, j], TINY)
            grown = r + RATE * change / seen
            signal = max(r, grown) * seen
            least = max(signal, usual * seen)
            move = rate * shift * signal / (least * least + TINY)
            moved = t + min(max(move, -frame.resolution), frame.resolution)
            t = where(there, moved - frame.period * floor(moved / frame.period), t)
            r = where(there, max(grown, 0), r)
        new_depth[i, k, j], new_intensity[i, k, j] = t, where(r >= faintest, r, 0)


def pixelwise(frame, table, rate, usual, depth, intensity, faintest=0.0):
    after = np.zeros_like(depth), np.zeros_like(intensity)
    _pixelwise(frame, table, F32(rate), F32(usual), F32(faintest), depth, intensity, *after)
    return after


def blur(values, sigma):
    from scipy.ndimage import correlate1d  # here: slow
    for axis in (0, 2):
        values = correlate1d(values, maps.window_weights(sigma), axis, mode="constant")
    return values


def usual_intensity(intensity, exposure):
    used = exposure > 0
    return float(intensity.max(axis=1)[used].mean()) if used.any() else 0.0


def median_depth(depth, intensity):
    seen = depth[intensity > 0]
    return float(np.median(seen)) if len(seen) else 0.0


@inline
def _between(place, values):
    """The value at `place`, an index between entries; 0 outside."""
    low = int(place)
    if low + 1 >= len(values):
        return ZERO
    return values[low] + (place - F32(low)) * (values[low + 1] - values[low])


@parallel
def _poisson(starts: int64[::1], toa: floats1d, irf: floats2d, slope: floats2d, exposure: floats2d, ref: float32,
             information: float32, num_bins: float32, background: floats2d, rate: float32, usual: float32,
             depth: floats3d, intensity: floats3d, stray: floats2d):
    (rows, cols), surfaces = background.shape, depth.shape[1]
    reach = ONE / np.sqrt(information)
    for i in prange(rows):
        a = i + MARGIN
        value, rise = np.empty(surfaces, np.float32), np.empty(surfaces, np.float32)
        signal, score = np.empty(surfaces, np.float32), np.empty(surfaces, np.float32)
        for j in range(cols):
            p, b = i * cols + j, j + MARGIN
            seen = exposure[i, j]
            stray[i, j] = ZERO
            if seen <= ZERO:
                continue
            own = p if len(irf) > 1 else 0
            signal[:], score[:] = ZERO, ZERO
            for photon in range(starts[p], starts[p + 1]):
                total = background[i, j]
                for k in range(surfaces):
                    value[k], rise[k] = ZERO, ZERO
                    if intensity[a, k, b] > ZERO:
                        place = toa[photon] - depth[a, k, b] + ref
                        place -= num_bins * np.floor(place / num_bins)
                        value[k], rise[k] = _between(place, irf[own]), _between(place, slope[own])
                        total += intensity[a, k, b] * value[k]
                if total > ZERO:
                    stray[i, j] += background[i, j] / total
                    for k in range(surfaces):
                        signal[k] += intensity[a, k, b] * value[k] / total
                        score[k] -= intensity[a, k, b] * rise[k] / total
            for k in range(surfaces):
                if intensity[a, k, b] > ZERO:
                    least = max(signal[k], usual * seen)
                    move = rate * score[k] / (least * information + TINY)
                    t = depth[a, k, b] + min(max(move, -reach), reach)
                    depth[a, k, b] = t - num_bins * np.floor(t / num_bins)
                    expected = intensity[a, k, b] * seen
                    change = RATE * (signal[k] - expected) / (max(expected, usual * seen) + TINY)
                    intensity[a, k, b] *= np.exp(min(change, ONE))


def poisson(frame, background, rate, usual, depth, intensity):
    """Gradient step on Σ_p ln(Σ_k r_k h(x_p − t_k) + b) − g Σ_k r_k, in every pixel.

    With q_pk = r_k h(x_p − t_k) / (Σ r h + b) and s_k = Σ_p q_pk:
    t_k += rate · (−Σ_p q_pk h′/h) / (max(s_k, usual g) J), at most 1/√J, J the information;
    ln r_k += INTENSITY_RATE · (s_k − g r_k) / max(g r_k, usual g), at most 1.

    Args:
        frame: a `Likelihood` of `core.baselines.rt3d`.
        background: float32 [rows, cols], b, photons per bin at g = 1.
        rate: of the full step in depth.
        usual: intensity below which the curvatures at `usual` are taken.
        depth, intensity: float32 [rows', K, cols'], bins and photons; changed in place.

    Returns:
        float32 [rows, cols], Σ_p b / (Σ r h + b): photons of the background.
    """
    stray = np.zeros_like(background)
    _poisson(frame.starts, frame.toa, frame.irf, frame.slope, frame.exposure, F32(frame.ref), F32(frame.information),
             F32(frame.num_bins), background, F32(rate), F32(usual), depth, intensity, stray)
    return stray
