"""Sums over cells of pixels, and Gaussian sums Σ_ab w_a w_b · values[i + a, c, j + b]: over rows, then columns.

Maps are padded (`kernels.maps`), so that windows need no bounds checks.

Windows along planes that fall, stay and rise are Σ w z exp(−i ω_l slope · d): rows are summed downwards, the sums to
the right. At distance d before and after a cell, a slope turns phases by φ and −φ: one sum over w cos φ (z₊ + z₋) and
one over w sin φ (z₊ − z₋) give both the falling and the rising line.
"""

from typing import NamedTuple

import numpy as np

from srt3d_ros.kernels.cpu.arithmetic import F32, ZERO
from srt3d_ros.kernels.cpu.compiling import floats3d, inline, line
from srt3d_ros.kernels.cpu.method.frame import columns
from srt3d_ros.kernels.cpu.vectors import fma, full, lane_numbers, lanes_of, load, sqrt, store
from srt3d_ros.kernels.maps import LANES, MARGIN

NEVER = F32(np.inf)         # a score that no cell reaches
SLANTS = 3                  # falling, flat and rising
DOWN, RIGHT = (1, 0), (0, 1)


class Cells(NamedTuple):
    """Sums over cells of pixels, padded: [rows', …, cols'] each."""

    z: floats3d             # [rows', 2m, cols']
    counts: floats3d        # [rows', 1, cols']
    exposure: floats3d
    wanted: floats3d        # how many pixels count


@inline
def _sums(values, wanted, c, row, first, right, step, total):
    """The sums over the wanted pixels of LANES cells, from (row, first) on: of rows, then of columns."""
    for part in range(step):
        j, value = first + part * LANES, full(ZERO)
        for i in range(row, row + step if j < right else row):      # nothing is beyond the image
            value = fma(load(values, i, c, j), load(wanted, i, 0, j), value)
        store(total, part * LANES, value)
    value = full(ZERO)
    for b in range(step):
        value += load(total, lane_numbers() * step + b)
    return value


@line
def bin_row(row, step, pixels, cells, total):
    """Write a row of cells, the sums over their wanted pixels; `total`, of LANES · step or more, is scratch.

    LANES cells are `step` whole vectors of pixels wide. Cells without a wanted pixel, now and at the last time, are 0.
    """
    first_row, right = (row - MARGIN) * step + MARGIN, pixels.wanted.shape[2] - MARGIN
    for col in columns(cells.wanted):
        first, number = (col - MARGIN) * step + MARGIN, load(cells.wanted, row, 0, col)
        for i in range(first_row, first_row + step):
            for j in range(first, min(first + step * LANES, right), LANES):
                number += load(pixels.wanted, i, 0, j)
        if lanes_of(number > ZERO) == 0:
            continue
        for values, out in zip(pixels, cells):
            for c in range(values.shape[1]):        # known steps make fast code
                value = (_sums(values, pixels.wanted, c, first_row, first, right, 1, total) if step == 1 else
                         _sums(values, pixels.wanted, c, first_row, first, right, 2, total) if step == 2 else
                         _sums(values, pixels.wanted, c, first_row, first, right, step, total))
                store(out, row, c, col, value)


@inline
def is_asked(least, col, beside):
    """Whether a score is asked for in some of LANES columns, or in those `beside` them."""
    return lanes_of(min(load(least, col - beside), load(least, col), load(least, col + beside)) < NEVER) != 0


@line
def blur_row(values, row, weights, least, total, out):
    """Write the windows around a row, where a score is asked for: out [C, cols']. `total` has margins of 0."""
    radius = len(weights) // 2
    for c in range(values.shape[1]):
        for col in columns(values):
            if is_asked(least, col, LANES):
                value = full(ZERO)
                for tap in range(len(weights)):
                    value = fma(load(values, row + tap - radius, c, col), weights[tap], value)
                store(total, col, value)
        for col in columns(values):
            if is_asked(least, col, 0):
                value = full(ZERO)
                for tap in range(len(weights)):
                    value = fma(load(total, col + tap - radius), weights[tap], value)
                store(out, c, col, value)


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
def _along(values, row, channel, col, way, turns, l):
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
    even_re, odd_re, flat_re = _along(values, row, l, col, way, turns, l)
    even_im, odd_im, flat_im = _along(values, row, len(turns) + l, col, way, turns, l)
    return (even_re - odd_im, even_im + odd_re), (flat_re, flat_im), (even_re + odd_im, even_im - odd_re)


@line
def pool_along(way, values, row, turns, least, out):
    """Sum the values [rows, 2m, cols'] around a row downwards or to the right, along three slopes: [SLANTS, 2m, cols'].

    Sums are written where a score is asked for, and downwards also beside that, for those to the right.
    """
    m = len(turns)
    for col in columns(out):
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
