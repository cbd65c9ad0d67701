"""The matched filter on a sketch, R(z, t) = Σ_l Re(z_l exp(−i ω_l t)), and where it peaks: `match`.

t_k = arg max_t R(z, t), r_k = R(z, t_k) / E, then z_l −= r_k |ĥ_l|² exp(i ω_l t_k), for k = 1 … K. R is computed at
cells, equal parts of the period, for BLOCK pixels at a time; a parabola through the highest cell and its neighbours
gives the peak.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import boolean, float32, int64, prange

from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, TWO, ZERO, B, U, aligned, sincos, total_of
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.maps import BLOCK, MARGIN

GROUP = U(16)       # cells whose sums are in the first-level cache together, 8 kB
FOUR = U(4)         # cells that are added to at once
EVEN_COS, EVEN_SIN, ODD_COS, ODD_SIN, SUMS = (U(k) * GROUP * B for k in range(5))   # where each sum begins


class Steering(NamedTuple):
    """Cosines and sines of ω_l t at the cells."""

    cos: float32[:, ::1]        # [m, cells / 4 + 4], of the first quarter of the period
    sin: float32[:, ::1]
    odd: boolean[::1]           # [m], whether k_l is odd
    cells: int64                # of the whole period


def steering(bin_frequencies, num_bins) -> Steering:
    """Steering for frequencies, float32 [m] cycles per bin."""
    return _steering(tuple(np.rint(bin_frequencies.astype(np.float64) * num_bins)))


@lru_cache
def _steering(frequencies) -> Steering:
    frequencies = np.array(frequencies)
    cells = 16 * int(np.ceil(frequencies.max() / 4))
    turns = np.outer(frequencies, np.arange(cells // 4 + 4)) / cells
    cos, sin = (f(2 * np.pi * turns).astype(np.float32) for f in (np.cos, np.sin))
    return Steering(cos, sin, frequencies % 2 > 0, cells)


@inline
def _add_four(wave, cell, z, part, sums, at):
    """Add a part of z times the wave to the sums of four cells; of one cell at a time it takes three times as long."""
    a, b, c, d = wave[cell], wave[cell + U(1)], wave[cell + U(2)], wave[cell + U(3)]
    for x in range(B):
        value = z[part + x]
        sums[at + x] += a * value
        sums[at + B + x] += b * value
        sums[at + U(2) * B + x] += c * value
        sums[at + U(3) * B + x] += d * value


@line
def _respond(z, steering, sums, response):
    """Write R(z, t) of BLOCK pixels at all cells: response[cell · BLOCK + pixel].

    Cells of the first quarter of the period have three mirror images: at T/2 − t, T/2 + t and T − t, cos ω_l t and
    sin ω_l t keep their size and change their signs by whether k_l is even or odd. So the sums over even k_l and over
    odd k_l of Re z_l cos ω_l t and Im z_l sin ω_l t are computed for a quarter of the cells, and added with four
    combinations of signs.
    """
    cos, sin, odd, cells = steering
    m, quarter = U(len(odd)), U(cells // 4)
    for first in range(U(0), quarter + U(1), GROUP):
        count = min(GROUP, quarter + U(1) - first)
        for x in range(SUMS):
            sums[x] = ZERO
        for l in range(m):
            re, im = l * B, (m + l) * B
            of_cos, of_sin = (ODD_COS, ODD_SIN) if odd[l] else (EVEN_COS, EVEN_SIN)
            for g in range(U(0), count, FOUR):
                _add_four(cos[l], first + g, z, re, sums, of_cos + g * B)
                _add_four(sin[l], first + g, z, im, sums, of_sin + g * B)
        for g in range(count):
            at, cell = g * B, first + g
            half_minus, half_plus = (U(2) * quarter - cell) * B, (U(2) * quarter + cell) * B
            itself, minus = cell * B, (U(4) * quarter - cell) * B
            a, b, c, d = EVEN_COS + at, EVEN_SIN + at, ODD_COS + at, ODD_SIN + at
            for x in range(B):
                response[itself + x] = sums[a + x] + sums[b + x] + sums[c + x] + sums[d + x]
            for x in range(B):
                response[half_minus + x] = sums[a + x] - sums[b + x] - sums[c + x] + sums[d + x]
            for x in range(B):
                response[half_plus + x] = sums[a + x] + sums[b + x] - sums[c + x] - sums[d + x]
            for x in range(B):
                response[minus + x] = sums[a + x] - sums[b + x] + sums[c + x] - sums[d + x]


@line
def peaks(z, steering, period, scratch, place, height):
    """Write places (bins) and heights of the highest peaks of R(z, t) of BLOCK pixels.

    Args:
        z: float32 [2m · BLOCK], real parts before imaginary ones.
        scratch: of `peaks_scratch`.
    """
    sums, response, top = scratch
    cells = steering.cells
    _respond(z, steering, sums, response)
    for x in range(B):
        height[x], top[x] = response[x], ZERO
    for g in range(U(1), U(cells)):
        at, here = g * B, F32(g)
        for x in range(B):
            r = response[at + x]
            top[x] = here if r > height[x] else top[x]
            height[x] = max(r, height[x])
    for x in range(B):
        best, cell = height[x], U(top[x])
        before = response[(cell - U(1) if cell > U(0) else U(cells) - U(1)) * B + x]
        after = response[(cell + U(1) if cell + U(1) < U(cells) else U(0)) * B + x]
        bend = before - TWO * best + after
        shift = HALF * (before - after) / bend if bend < ZERO else ZERO
        place[x] = (top[x] + shift) * (period / F32(cells))
        height[x] = best - F32(0.25) * (before - after) * shift


@inline
def response_at(z, first, step, bin_frequencies, depth):
    """R(z, depth) of a pixel whose numbers lie `step` apart in z from `first` on."""
    response, m = ZERO, len(bin_frequencies)
    for l in range(m):
        sine, cosine = sincos(bin_frequencies[l] * depth)
        response += z[first + l * step] * cosine + z[first + (m + l) * step] * sine
    return response


@inline
def peaks_scratch(cells):
    """Scratch memory of `peaks`."""
    return aligned(int(SUMS)), aligned((cells + 1) * BLOCK), aligned(BLOCK)


@parallel
def _match(frame: Frame, steering: Steering, depth: float32[:, :, ::1], intensity: float32[:, :, ::1]):
    rows, surfaces, cols = depth.shape
    matched, energy, bin_frequencies = frame.matched, frame.energy, frame.bin_frequencies
    m, total = len(energy), total_of(energy)
    for turn in prange(rows - 2 * MARGIN):
        i = turn + MARGIN
        scratch, z = peaks_scratch(steering.cells), aligned(2 * m * BLOCK)
        place, height = aligned(BLOCK), aligned(BLOCK)
        for j in range(MARGIN, cols - MARGIN, BLOCK):
            for c in range(2 * m):
                for x in range(BLOCK):
                    z[c * BLOCK + x] = matched[i, c, j + x]
            for k in range(surfaces):
                peaks(z, steering, frame.period, scratch, place, height)
                for x in range(BLOCK):
                    depth[i, k, j + x] = place[x]
                    intensity[i, k, j + x] = height[x] / total
                if k + 1 < surfaces:
                    for l in range(m):
                        for x in range(BLOCK):
                            sine, cosine = sincos(bin_frequencies[l] * place[x])
                            z[l * BLOCK + x] -= height[x] / total * energy[l] * cosine
                            z[(m + l) * BLOCK + x] -= height[x] / total * energy[l] * sine


def match(frame, surfaces):
    rows, _, cols = frame.matched.shape
    out = tuple(np.zeros((rows, surfaces, cols), np.float32) for _ in range(2))
    _match(frame, steering(frame.bin_frequencies, frame.num_bins), *out)
    return out
