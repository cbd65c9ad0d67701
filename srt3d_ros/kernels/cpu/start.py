"""Start of a reconstruction: pooled sketches at several scales and their matched filter."""

import numpy as np
from numba import prange

from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, TWO, ZERO, parallel, sincos


@parallel
def _blur_rows(values, weights, step, out):
    radius = (len(weights) - step) // 2
    rows, channels, cols = values.shape
    for i in prange(out.shape[0]):
        out[i] = ZERO
        for tap in range(len(weights)):
            a = i * step + tap - radius
            if 0 <= a < rows:
                for c in range(channels):
                    line, into, weight = values[a, c], out[i, c], weights[tap]
                    for j in range(cols):
                        into[j] += weight * line[j]


@parallel
def _blur_cols(values, weights, step, out):
    radius = (len(weights) - step) // 2
    rows, channels, cols = values.shape
    for i in prange(rows):
        line = np.zeros(out.shape[2] * step + 2 * radius, np.float32)
        for c in range(channels):
            line[radius:radius + cols] = values[i, c]
            into = out[i, c]
            into[:] = ZERO
            for tap in range(len(weights)):
                part, weight = line[tap:], weights[tap]
                for j in range(len(into)):
                    into[j] += weight * part[j * step]


def blur(values, weights, step):
    """Σ weights · values over a window around every block of `step` × `step` pixels; zero outside the image.

    Args:
        values: float32 [rows, C, cols].
        weights: float32 [2 · radius + step], for rows and for columns, centred on the block.

    Returns:
        float32 [⌈rows / step⌉, C, ⌈cols / step⌉].
    """
    rows, channels, cols = values.shape
    tall = np.empty((-(-rows // step), channels, cols), np.float32)
    _blur_rows(values, weights, step, tall)
    out = np.empty((tall.shape[0], channels, -(-cols // step)), np.float32)
    _blur_cols(tall, weights, step, out)
    return out


@parallel
def _match(matched, energy, cycles, cos, sin, num_bins, depth, intensity):
    rows, surfaces, cols = depth.shape
    m, grid = cos.shape
    total = energy.sum()
    bins_per_cell = F32(num_bins) / F32(grid)
    for i in prange(rows):
        response = np.empty(grid, np.float32)
        rest = np.empty(2 * m, np.float32)
        for j in range(cols):
            rest[:] = matched[i, :, j]
            for k in range(surfaces):
                response[:] = ZERO
                for l in range(m):
                    re, im, c, s = rest[l], rest[m + l], cos[l], sin[l]
                    for g in range(grid):
                        response[g] += re * c[g] + im * s[g]
                peak = response[0]
                for g in range(grid):
                    peak = max(peak, response[g])
                top = 0
                while top < grid - 1 and response[top] < peak:
                    top += 1
                before, after = response[top - 1 if top > 0 else grid - 1], response[top + 1 if top + 1 < grid else 0]
                bend = before - TWO * peak + after
                shift = HALF * (before - after) / bend if bend < ZERO else ZERO
                value = peak - F32(0.25) * (before - after) * shift
                t = (F32(top) + shift) * bins_per_cell
                depth[i, k, j] = t
                intensity[i, k, j] = value / total
                if k + 1 < surfaces:
                    for l in range(m):
                        sine, cosine = sincos(cycles[l] * t)
                        rest[l] -= value / total * energy[l] * cosine
                        rest[m + l] -= value / total * energy[l] * sine


def match(matched, energy, cycles, num_bins, surfaces):
    """The K strongest returns of every pixel by matched filter and matching pursuit.

    The filter's response Σ_l Re(matched_l · exp(−i ω_l t)) has no frequency above max k: a grid of 4 · max k cells and
    a parabola through the highest one find its peak, however many bins there are.

    Args:
        matched: float32 [rows, 2m, cols], conj(ĥ_l) · Σ_p exp(i ω_l x_p), real parts before imaginary ones.
        energy: float32 [m], |ĥ_l|².
        cycles: float32 [m], k_l / T.
        num_bins: T.
        surfaces: K.

    Returns:
        depth (bins) and intensity (Σ w r), float32 [rows, K, cols].
    """
    frequencies = np.rint(cycles.astype(np.float64) * num_bins)
    grid = 16 * int(np.ceil(frequencies.max() / 4))
    turns = np.outer(frequencies, np.arange(grid)) / grid
    cos, sin = (f(2 * np.pi * turns).astype(np.float32) for f in (np.cos, np.sin))
    rows, _, cols = matched.shape
    out = tuple(np.empty((rows, surfaces, cols), np.float32) for _ in range(2))
    _match(matched, energy, cycles, cos, sin, num_bins, *out)
    return out
