"""Sums of cells along planes that fall, stay and rise, Σ w z exp(−i ω_l slope · d), for the windows of `search`.

A window is separable: rows are summed downwards, and the sums to the right. At distance d before and after a cell, a
slope turns phases by φ and −φ: one sum over w cos φ (z₊ + z₋) and one over w sin φ (z₊ − z₋) give both the falling and
the rising line.
"""

import numpy as np

from srt3d_ros.kernels.cpu.arithmetic import ZERO
from srt3d_ros.kernels.cpu.compiling import inline, line
from srt3d_ros.kernels.cpu.method.blur import is_asked
from srt3d_ros.kernels.cpu.vectors import fma, full, load, sqrt, store
from srt3d_ros.kernels.maps import LANES, MARGIN

SLANTS = 3                  # falling, flat and rising
DOWN, RIGHT = (1, 0), (0, 1)


def turns_of(weights, turns):
    """w, w cos φ and w sin φ of a window's cells at distances 1 … reach, along which a slope turns phases by φ.

    `turns` [m] are of one cell. Returns float32 [m, reach, 3].
    """
    apart = np.arange(1, len(weights) // 2 + 1)
    phase = 2 * np.pi * np.outer(turns, apart)
    ways = np.stack([np.ones_like(phase), np.cos(phase), np.sin(phase)], axis=2)
    return np.ascontiguousarray(weights[len(weights) // 2 + apart][:, None] * ways, np.float32)


@inline
def size(re, im):
    """|z| of re + i im."""
    return sqrt(fma(re, re, im * im))


@inline
def _sums(values, row, channel, col, way, turns, l):
    """z + Σ w cos φ (z₊ + z₋), Σ w sin φ (z₊ − z₋) and z + Σ w (z₊ + z₋)."""
    (down, right), middle = way, load(values, row, channel, col)
    even, odd, flat = middle, full(ZERO), middle
    for d in range(1, turns.shape[1] + 1):
        before = load(values, row - d * down, channel, col - d * right)
        after = load(values, row + d * down, channel, col + d * right)
        both = after + before
        flat = fma(both, turns[l, d - 1, 0], flat)
        even = fma(both, turns[l, d - 1, 1], even)
        odd = fma(after - before, turns[l, d - 1, 2], odd)
    return even, odd, flat


@inline
def _windows(values, row, l, col, way, turns):
    """Sums of z_l along lines that fall, stay and rise, real and imaginary: Σ w z exp(iφ), Σ w z and Σ w z exp(−iφ)."""
    even_re, odd_re, flat_re = _sums(values, row, l, col, way, turns, l)
    even_im, odd_im, flat_im = _sums(values, row, len(turns) + l, col, way, turns, l)
    return (even_re - odd_im, even_im + odd_re), (flat_re, flat_im), (even_re + odd_im, even_im - odd_re)


@line
def pool_along(way, values, row, turns, least, out):
    """Sum the values [rows, 2m, cols'] around a row downwards or to the right, along three slopes: [SLANTS, 2m, cols'].

    Sums are written where a score is asked for, and downwards also beside that, for those to the right.
    """
    m = len(turns)
    for col in range(MARGIN, out.shape[2] - MARGIN, LANES):
        if is_asked(least, col, LANES * way[0]):
            for l in range(m):
                falling, flat, rising = _windows(values, row, l, col, way, turns)
                for part in range(2):
                    store(out, 0, part * m + l, col, falling[part])
                    store(out, 1, part * m + l, col, flat[part])
                    store(out, 2, part * m + l, col, rising[part])


@line
def bound_across(lines, col, turns):
    """The largest Σ_l |z̄_l| of the slanted windows around each of LANES cells."""
    largest = full(ZERO)
    for down in range(SLANTS):
        falls, stays, rises = full(ZERO), full(ZERO), full(ZERO)
        for l in range(len(turns)):
            falling, flat, rising = _windows(lines, down, l, col, RIGHT, turns)
            falls, stays, rises = falls + size(*falling), stays + size(*flat), rises + size(*rising)
        largest = max(largest, falls, rises)
        if down != SLANTS // 2:
            largest = max(largest, stays)
    return largest
