"""The matched filter on a sketch, and where it peaks."""

from functools import lru_cache

import numpy as np
from numba import boolean, float32, int64, prange

from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, TWO, ZERO, B, U, aligned, sincos, total_of
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel
from srt3d_ros.kernels.maps import BLOCK

GROUP = U(16)                   # cells of a quarter turn whose sums are in the cache together
LIST = GROUP * B


def steering(bin_frequencies, num_bins):
    """As `_steering`, of float32 [m] cycles per bin."""
    return _steering(tuple(np.rint(bin_frequencies.astype(np.float64) * num_bins)))


@lru_cache
def _steering(frequencies):
    """Tables for `peaks`: cosines and sines at the cells of a quarter turn, which k are odd, and the cells of a turn.

    Returns:
        float32 [m, cells / 4 + 4] twice, bool [m], int.
    """
    frequencies = np.array(frequencies)
    cells = 16 * int(np.ceil(frequencies.max() / 4))
    turns = np.outer(frequencies, np.arange(cells // 4 + 4)) / cells
    return *(f(2 * np.pi * turns).astype(np.float32) for f in (np.cos, np.sin)), frequencies % 2 > 0, cells


@line
def _respond(z, cos, sin, odd, cells, s, response):
    """The matched filter Σ_l Re(z_l exp(−i ω_l t)) of BLOCK pixels at all cells of a turn.

    With a and b the sums of Re z cos and Im z sin over even k, c and d over odd k, the filter is a + b + c + d in a
    cell of the first quarter, and with other signs in its three mirror images: a quarter of the work finds all.
    """
    m, quarter = U(len(odd)), U(cells // 4)
    for first in range(U(0), quarter + U(1), GROUP):
        count = min(GROUP, quarter + U(1) - first)
        for x in range(U(4) * LIST):
            s[x] = ZERO
        for l in range(m):
            re, im = l * B, (m + l) * B
            into = U(2) * LIST if odd[l] else U(0)
            for g in range(U(0), count, U(4)):          # four at once: a short loop's checks cost more than it does
                at, cell = into + g * B, first + g
                c0, c1, c2, c3 = cos[l, cell], cos[l, cell + U(1)], cos[l, cell + U(2)], cos[l, cell + U(3)]
                d0, d1, d2, d3 = sin[l, cell], sin[l, cell + U(1)], sin[l, cell + U(2)], sin[l, cell + U(3)]
                for x in range(B):
                    u, v = z[re + x], z[im + x]
                    s[at + x] += c0 * u
                    s[at + B + x] += c1 * u
                    s[at + U(2) * B + x] += c2 * u
                    s[at + U(3) * B + x] += c3 * u
                    s[at + LIST + x] += d0 * v
                    s[at + LIST + B + x] += d1 * v
                    s[at + LIST + U(2) * B + x] += d2 * v
                    s[at + LIST + U(3) * B + x] += d3 * v
        for g in range(count):
            at, cell = g * B, first + g
            one, two = cell * B, (U(2) * quarter - cell) * B
            three, four = (U(2) * quarter + cell) * B, (U(4) * quarter - cell) * B
            b, c, d = at + LIST, at + U(2) * LIST, at + U(3) * LIST
            for x in range(B):
                response[one + x] = s[at + x] + s[b + x] + s[c + x] + s[d + x]
            for x in range(B):
                response[two + x] = s[at + x] - s[b + x] - s[c + x] + s[d + x]
            for x in range(B):
                response[three + x] = s[at + x] + s[b + x] - s[c + x] - s[d + x]
            for x in range(B):
                response[four + x] = s[at + x] - s[b + x] + s[c + x] - s[d + x]


@line
def peaks(z, cos, sin, odd, cells, period, scratch, place, height):
    """Write places (bins) and heights of the filter's highest peaks of BLOCK pixels, by a parabola through 3 cells.

    Args:
        z: float32 [2m · BLOCK], real parts before imaginary ones.
        cos, sin, odd, cells: of `steering`.
        scratch: of `peaks_scratch`.
    """
    sums, response, top = scratch
    _respond(z, cos, sin, odd, cells, sums, response)
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
    """The filter's response at a depth, of a pixel whose numbers lie `step` apart in z from `first` on."""
    response, m = ZERO, len(bin_frequencies)
    for l in range(m):
        sine, cosine = sincos(bin_frequencies[l] * depth)
        response += z[first + l * step] * cosine + z[first + (m + l) * step] * sine
    return response


@inline
def peaks_scratch(cells):
    """Scratch for `peaks`."""
    return aligned(4 * int(LIST)), aligned((cells + 1) * BLOCK), aligned(BLOCK)


@parallel
def _match(matched: float32[:, :, ::1], energy: float32[::1], bin_frequencies: float32[::1], cos: float32[:, ::1],
           sin: float32[:, ::1], odd: boolean[::1], cells: int64, num_bins: int64, depth: float32[:, :, ::1],
           intensity: float32[:, :, ::1]):
    rows, surfaces, cols = depth.shape
    m, total = len(energy), total_of(energy)
    for i in prange(rows):
        scratch, z = peaks_scratch(cells), aligned(2 * m * BLOCK)
        place, height = aligned(BLOCK), aligned(BLOCK)
        for j in range(0, cols, BLOCK):
            width = min(BLOCK, cols - j)
            for c in range(2 * m):
                for x in range(BLOCK):
                    z[c * BLOCK + x] = matched[i, c, j + x] if x < width else ZERO
            for k in range(surfaces):
                peaks(z, cos, sin, odd, cells, F32(num_bins), scratch, place, height)
                for x in range(width):
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
    out = tuple(np.empty((rows, surfaces, cols), np.float32) for _ in range(2))
    _match(frame.matched, frame.energy, frame.bin_frequencies, *steering(frame.bin_frequencies, frame.num_bins),
           frame.num_bins, *out)
    return out
