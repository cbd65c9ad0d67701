"""Gradient steps of every point on its own pixel's sketch."""

import numpy as np
from numba import prange

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, ONE, TINY, ZERO, sincos
from srt3d_ros.kernels.cpu.compiling import inline, parallel

RATE = F32(constants.INTENSITY_RATE)


@inline
def _subtract(i, k, rest, exposure, energy, bin_frequencies, depth, intensity, sine, cosine):
    """Take what surface k explains out of `rest`; keep its phases."""
    m, cols = sine.shape[1:]
    for l in range(m):
        for j in range(cols):
            s, c = sincos(bin_frequencies[l] * depth[i, k, j])
            seen = exposure[i, j] * intensity[i, k, j] * energy[l]
            rest[l, j] -= seen * c
            rest[m + l, j] -= seen * s
            sine[k, l, j], cosine[k, l, j] = s, c


@inline
def _errors(k, rest, table, level, sine, cosine, shift, change):
    """Estimate r · (error of t) and the error of r of surface k from what no surface explains."""
    m, cols = sine.shape[1:]
    shift[:], change[:] = ZERO, ZERO
    for l in range(m):
        for j in range(cols):
            re = rest[l, j] * cosine[k, l, j] + rest[m + l, j] * sine[k, l, j]
            im = rest[m + l, j] * cosine[k, l, j] - rest[l, j] * sine[k, l, j]
            shift[j] += table[level[j], 0, l] * re + table[level[j], 1, l] * im
            change[j] += table[level[j], 2, l] * re + table[level[j], 3, l] * im


@parallel
def _pixelwise(matched, photons, exposure, energy, bin_frequencies, num_bins, table, rate, usual, reach, depth,
               intensity):
    rows, surfaces, cols = depth.shape
    m, levels = len(energy), table.shape[0]
    for i in prange(rows):
        rest = matched[i].copy()
        sine, cosine = np.empty((surfaces, m, cols), np.float32), np.empty((surfaces, m, cols), np.float32)
        shift, change, level = np.empty(cols, np.float32), np.empty(cols, np.float32), np.zeros(cols, np.int64)
        for k in range(surfaces):
            if intensity[i, k].max() > ZERO:            # few rows have a second surface
                _subtract(i, k, rest, exposure, energy, bin_frequencies, depth, intensity, sine, cosine)
        for k in range(surfaces):
            if intensity[i, k].max() <= ZERO:
                continue
            for j in range(cols):
                share = exposure[i, j] * intensity[i, k, j] / max(photons[i, j], ONE)
                level[j] = int(min(share, ONE) * F32(levels - 1) + HALF)
            _errors(k, rest, table, level, sine, cosine, shift, change)
            for j in range(cols):
                if intensity[i, k, j] > ZERO:
                    seen = max(exposure[i, j], TINY)
                    after = intensity[i, k, j] + RATE * change[j] / seen
                    signal = max(intensity[i, k, j], after) * seen
                    least = max(signal, usual * seen)
                    move = min(max(rate * shift[j] * signal / (least * least + TINY), -reach), reach)
                    t = depth[i, k, j] + move
                    depth[i, k, j] = t - num_bins * np.floor(t / num_bins)
                    intensity[i, k, j] = max(after, ZERO)


def pixelwise(frame, table, rate, usual, depth, intensity):
    """Rows in parallel."""
    _pixelwise(frame.matched, frame.counts, frame.exposure, frame.energy, frame.bin_frequencies, F32(frame.num_bins),
               table, F32(rate), F32(usual), F32(frame.resolution_bins), depth, intensity)
