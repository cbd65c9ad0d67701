"""The baselines' gradient steps, on each pixel's sketch and on the Poisson likelihood of its times of arrival.

`pixelwise`: with d_l = (z_l − g Σ_k r_k |ĥ_l|² exp(i ω_l t_k)) exp(−i ω_l t), rows a of the table give
Δ_rt = a₀ · Re d + a₁ · Im d and Δ_r = a₂ · Re d + a₃ · Im d; t += rate Δ_rt s / max(s, usual g)², at most δ, and
r += INTENSITY_RATE Δ_r / g, at least 0, with s = g max(r, the new r).
"""

from typing import NamedTuple

import numpy as np
from numba import float32, int64, prange

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, ONE, TINY, ZERO, sincos
from srt3d_ros.kernels.cpu.compiling import inline, parallel
from srt3d_ros.kernels.cpu.method.frame import Frame

RATE = F32(constants.INTENSITY_RATE)


@parallel
def _pixelwise(frame: Frame, table: float32[:, :, ::1], rate: float32, usual: float32, depth: float32[:, :, ::1],
               intensity: float32[:, :, ::1]):
    rows, surfaces, cols = depth.shape
    m, levels = len(frame.energy), len(table)
    for i in prange(rows):
        rest, photons, exposure = frame.matched[i].copy(), frame.counts[i], frame.exposure[i]
        sine, cosine = np.empty((surfaces, m, cols), np.float32), np.empty((surfaces, m, cols), np.float32)
        shift, change, level = np.empty(cols, np.float32), np.empty(cols, np.float32), np.empty(cols, np.int64)
        for k in range(surfaces):
            if intensity[i, k].max() <= ZERO:           # few rows have a second surface
                continue
            for l in range(m):
                for j in range(cols):
                    s, c = sincos(frame.bin_frequencies[l] * depth[i, k, j])
                    seen = exposure[j] * intensity[i, k, j] * frame.energy[l]
                    rest[l, j] -= seen * c              # what no surface explains
                    rest[m + l, j] -= seen * s
                    sine[k, l, j], cosine[k, l, j] = s, c
        for k in range(surfaces):
            if intensity[i, k].max() <= ZERO:
                continue
            for j in range(cols):
                share = exposure[j] * intensity[i, k, j] / max(photons[j], ONE)
                level[j] = int(min(share, ONE) * F32(levels - 1) + HALF)
            shift[:], change[:] = ZERO, ZERO            # Δ_rt and Δ_r
            for l in range(m):
                for j in range(cols):
                    s, c, a = sine[k, l, j], cosine[k, l, j], table[level[j]]
                    re, im = rest[l, j] * c + rest[m + l, j] * s, rest[m + l, j] * c - rest[l, j] * s
                    shift[j] += a[0, l] * re + a[1, l] * im
                    change[j] += a[2, l] * re + a[3, l] * im
            for j in range(cols):
                if intensity[i, k, j] > ZERO:
                    seen = max(exposure[j], TINY)
                    after = intensity[i, k, j] + RATE * change[j] / seen
                    signal = max(intensity[i, k, j], after) * seen
                    least = max(signal, usual * seen)
                    move = rate * shift[j] * signal / (least * least + TINY)
                    t = depth[i, k, j] + min(max(move, -frame.resolution), frame.resolution)
                    depth[i, k, j] = t - frame.period * np.floor(t / frame.period)
                    intensity[i, k, j] = max(after, ZERO)


def pixelwise(frame, table, rate, usual, depth, intensity):
    points = depth.copy(), intensity.copy()
    _pixelwise(frame, table, F32(rate), F32(usual), *points)
    return points


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


class TimesOfArrival(NamedTuple):
    """The fields of a `Likelihood` of `core.baselines.rt3d`, numbers in single precision."""

    starts: int64[::1]
    toa: float32[::1]
    irf: float32[:, ::1]
    slope: float32[:, ::1]
    exposure: float32[:, ::1]
    ref: float32
    information: float32
    num_bins: float32


@parallel
def _poisson(photons: TimesOfArrival, background: float32[:, ::1], rate: float32, usual: float32,
             depth: float32[:, :, ::1], intensity: float32[:, :, ::1], stray: float32[:, ::1]):
    starts, toa, irf, slope, exposure, ref, information, num_bins = photons
    rows, surfaces, cols = depth.shape
    reach = ONE / np.sqrt(information)
    for i in prange(rows):
        value, rise = np.empty(surfaces, np.float32), np.empty(surfaces, np.float32)
        signal, score = np.empty(surfaces, np.float32), np.empty(surfaces, np.float32)
        for j in range(cols):
            p = i * cols + j
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
                    if intensity[i, k, j] > ZERO:
                        place = toa[photon] - depth[i, k, j] + ref
                        place -= num_bins * np.floor(place / num_bins)
                        value[k], rise[k] = _between(place, irf[own]), _between(place, slope[own])
                        total += intensity[i, k, j] * value[k]
                if total > ZERO:
                    stray[i, j] += background[i, j] / total
                    for k in range(surfaces):
                        signal[k] += intensity[i, k, j] * value[k] / total
                        score[k] -= intensity[i, k, j] * rise[k] / total
            for k in range(surfaces):
                if intensity[i, k, j] > ZERO:
                    least = max(signal[k], usual * seen)
                    move = rate * score[k] / (least * information + TINY)
                    t = depth[i, k, j] + min(max(move, -reach), reach)
                    depth[i, k, j] = t - num_bins * np.floor(t / num_bins)
                    expected = intensity[i, k, j] * seen
                    change = RATE * (signal[k] - expected) / (max(expected, usual * seen) + TINY)
                    intensity[i, k, j] *= np.exp(min(change, ONE))


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
        depth, intensity: float32 [rows, K, cols], bins and photons; changed in place.

    Returns:
        float32 [rows, cols], Σ_p b / (Σ r h + b): photons of the background.
    """
    stray = np.zeros_like(background)
    photons = TimesOfArrival(frame.starts, frame.toa, frame.irf, frame.slope, frame.exposure, F32(frame.ref),
                      F32(frame.information), F32(frame.num_bins))
    _poisson(photons, background, F32(rate), F32(usual), depth, intensity, stray)
    return stray
