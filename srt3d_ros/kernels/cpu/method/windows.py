"""Sums over cells of pixels, and Gaussian sums Σ_ab w_a w_b · values[i + a, c, j + b]: `down` the rows, then `across`.

Maps are padded (`kernels.maps`), so that windows need no bounds checks.

Windows along planes that fall, stay and rise are Σ w z exp(−i ω_l slope · d): rows are summed downwards, the sums to
the right. At distance d before and after a cell, a slope turns phases by φ and −φ: one sum over w cos φ (z₊ + z₋) and
one over w sin φ (z₊ − z₋) give both the falling and the rising line.
"""

from typing import NamedTuple

import numpy as np

from srt3d_ros.kernels.cpu.compiling import each, floats1d, floats3d, inline, line
from srt3d_ros.kernels.cpu.spans import columns, first_of, span
from srt3d_ros.kernels.cpu.vectors import fma, full, lane_numbers, lanes_of, sqrt
from srt3d_ros.kernels.maps import LANES, MARGIN

NEVER = np.inf        # a score that no cell reaches
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
        j, value = first + part * LANES, full(0.0)
        for i in range(row, row + step if j < right else row):      # nothing is beyond the image
            value = fma(values[i, c, span(j)], wanted[i, 0, span(j)], value)
        total[span(part * LANES)] = value
    value = full(0.0)
    for b in range(step):
        value += total[lane_numbers() * step + b]
    return value


@line
def bin_row(row, step, pixels, cells, total):
    """Write a row of cells, the sums over their wanted pixels; `total`, of LANES · step or more, is scratch.

    LANES cells are `step` whole vectors of pixels wide. Cells without a wanted pixel, now and at the last time, are 0.
    """
    first_row, right = (row - MARGIN) * step + MARGIN, pixels.wanted.shape[2] - MARGIN
    for col in columns(cells.wanted):
        first, number = (first_of(col) - MARGIN) * step + MARGIN, cells.wanted[row, 0, col]
        for i in range(first_row, first_row + step):
            for j in range(first, min(first + step * LANES, right), LANES):
                number += pixels.wanted[i, 0, span(j)]
        if lanes_of(number > 0) == 0:
            continue
        for values, out in zip(pixels, cells):
            for c in range(values.shape[1]):        # known steps make fast code
                value = (_sums(values, pixels.wanted, c, first_row, first, right, 1, total) if step == 1 else
                         _sums(values, pixels.wanted, c, first_row, first, right, 2, total) if step == 2 else
                         _sums(values, pixels.wanted, c, first_row, first, right, step, total))
                out[row, c, col] = value


@inline
def down(values, i, c, j, weights):
    """Σ_a w_a · values[i + a, c, j]."""
    value, first = full(0.0), i - len(weights) // 2
    for tap in range(len(weights)):
        value = fma(values[first + tap, c, j], weights[tap], value)
    return value


@inline
def across(values, i, c, j, weights):
    """Σ_b w_b · values[i, c, j + b]."""
    value, first = full(0.0), j - len(weights) // 2
    for tap in range(len(weights)):
        value = fma(values[i, c, first + tap], weights[tap], value)
    return value


@each
def _sum_down(i, values: floats3d, window: floats1d, summed: floats3d):
    for c in range(values.shape[1]):        # one by one: their rows stay in the cache
        for j in columns(values):
            summed[i, c, j] = down(values, i, c, j, window)


def sum_down(work, values, window):
    """The sums over rows of all channels, for `across`; valid until the next ones of as many channels."""
    summed = work.map("summed", values.shape[1])
    _sum_down(values, window, summed)
    return summed


@inline
def is_asked(least, col, beside):
    """Whether a score is asked for in some of LANES columns, or in those `beside` them."""
    return lanes_of(min(least[col - beside], least[col], least[col + beside]) < NEVER) != 0


@line
def blur_row(values, row, weights, least, total, out):
    """Write the windows [C, cols'] around a row, where a score is asked for. `total` [1, 1, cols'] has margins of 0."""
    for c in range(values.shape[1]):
        for col in columns(values):
            if is_asked(least, col, LANES):
                total[0, 0, col] = down(values, row, c, col, weights)
        for col in columns(values):
            if is_asked(least, col, 0):
                out[c, col] = across(total, 0, 0, col, weights)


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
    (down, right), middle = way, values[row, channel, col]
    even, odd, flat = middle, full(0.0), middle
    for d in range(1, turns.shape[1] + 1):
        before = values[row - d * down, channel, col - d * right]
        after = values[row + d * down, channel, col + d * right]
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
                    out[0, part * m + l, col] = falling[part]
                    out[1, part * m + l, col] = flat[part]
                    out[2, part * m + l, col] = rising[part]


@line
def bound_across(lines, col, turns):
    """The largest Σ_l |z̄_l| of the slanted windows around each of LANES cells."""
    largest = full(0.0)
    for down in range(SLANTS):
        falls, stays, rises = full(0.0), full(0.0), full(0.0)
        for l in range(len(turns)):
            falling, flat, rising = _windows(lines, down, l, col, RIGHT, turns)
            falls, stays, rises = falls + size(*falling), stays + size(*flat), rises + size(*rising)
        largest = max(largest, falls, rises)
        if down != SLANTS // 2:
            largest = max(largest, stays)
    return largest
