"""Gradient steps of every point on the Poisson likelihood of its pixel's times of arrival."""

import numpy as np
from numba import prange

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, TINY, ZERO
from srt3d_ros.kernels.cpu.compiling import inline, parallel

RATE = F32(constants.INTENSITY_RATE)


@inline
def _irf_at(place, irf, slope, num_bins):
    """h and h′ at `place`, an index into the IRF between entries, modulo T; 0 outside."""
    place -= num_bins * np.floor(place / num_bins)
    if place > num_bins - ONE:
        place -= num_bins                                   # rises from 0 before the first entry
    low = int(np.floor(place))
    part = place - F32(low)
    value, rise, length = ZERO, ZERO, len(irf)
    if 0 <= low < length:
        value += (ONE - part) * irf[low]
        rise += (ONE - part) * slope[low]
    if 0 <= low + 1 < length:
        value += part * irf[low + 1]
        rise += part * slope[low + 1]
    return value, rise


@parallel
def _poisson(starts, toa, irf, slope, ref, information, num_bins, exposure, background, rate, usual, depth, intensity,
             stray):
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
                        value[k], rise[k] = _irf_at(toa[photon] - depth[i, k, j] + ref, irf[own], slope[own], num_bins)
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
    """Rows in parallel."""
    stray = np.zeros_like(background)
    _poisson(frame.starts, frame.toa, frame.irf, frame.slope, F32(frame.ref), F32(frame.information),
             F32(frame.num_bins), frame.exposure, background, F32(rate), F32(usual), depth, intensity, stray)
    return stray
