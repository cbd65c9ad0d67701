"""Gradient steps of every point on its own pixel's sketch."""

import numpy as np
from numba import prange

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, ONE, TINY, ZERO, sincos
from srt3d_ros.kernels.cpu.compiling import inline, parallel

RATE = F32(constants.INTENSITY_RATE)


@inline
def _subtract(i, k, rest, exposure, energy, cycles, depth, intensity, sine, cosine):
    """Take what surface k explains out of `rest`; keep its phases."""
    m, cols = sine.shape[1:]
    for l in range(m):
        for j in range(cols):
            s, c = sincos(cycles[l] * depth[i, k, j])
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
def _pixelwise(matched, photons, exposure, energy, cycles, num_bins, table, rate, usual, reach, depth, intensity):
    rows, surfaces, cols = depth.shape
    m, levels = len(energy), table.shape[0]
    for i in prange(rows):
        rest = matched[i].copy()
        sine, cosine = np.empty((surfaces, m, cols), np.float32), np.empty((surfaces, m, cols), np.float32)
        shift, change, level = np.empty(cols, np.float32), np.empty(cols, np.float32), np.zeros(cols, np.int64)
        for k in range(surfaces):
            if intensity[i, k].max() > ZERO:            # few rows have a second surface
                _subtract(i, k, rest, exposure, energy, cycles, depth, intensity, sine, cosine)
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


def pixelwise(data, table, rate, usual, depth, intensity):
    """One gradient step in depth and intensity on n (z − Ψ_θ)ᵀ W (z − Ψ_θ), in place.

    With d_l = (what the points of the pixel leave of matched_l) · exp(−i ω_l t), a linear function of d, the gradient
    over the curvature, estimates r · (error of t) and the error of r (see `srt3d_ros.core.weighting`). Half of
    the latter is the step in intensity. In depth the curvature is r² times a constant; for weak points that of the
    usual intensity bounds it, so that noise does not throw them about.

    Args:
        data: the frame (see `srt3d_ros.core.frame.Frame`), not padded.
        table: float32 [levels, 4, m], weights of Re d and Im d for depth, then for intensity, for shares of signal
            from 0 to 1 of the pixel's photons.
        rate: of the full step, for depths.
        usual: intensity below which points move less than their curvature allows; 0 for none.
        depth, intensity: float32 [rows, K, cols]; 0 = no point. Changed in place.
    """
    _pixelwise(data.matched, data.noise, data.exposure, data.energy, data.cycles, F32(data.num_bins), table,
               F32(rate), F32(usual), F32(data.resolution_bins), depth, intensity)
