"""Sums over cells of pixels, and Gaussian sums Σ_ab w_a w_b · values[i + a, c, j + b]: over rows, then columns.

Maps are padded (`kernels.maps`), so that windows need no bounds checks.
"""

from typing import NamedTuple

import numpy as np
from numba import float32, get_num_threads, get_thread_id, prange

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.cpu.arithmetic import F32, ZERO
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel
from srt3d_ros.kernels.cpu.vectors import fma, full, gather, lane_numbers, lanes_of, load, store
from srt3d_ros.kernels.maps import LANES, MARGIN

NEVER = F32(np.inf)         # a score that no cell reaches


class Cells(NamedTuple):
    """Sums over cells of pixels, padded: [rows', …, cols'] each."""

    z: float32[:, :, ::1]           # [rows', 2m, cols']
    counts: float32[:, :, ::1]      # [rows', 1, cols']
    exposure: float32[:, :, ::1]
    wanted: float32[:, :, ::1]      # how many pixels count


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
        value += gather(total, lane_numbers() * step + b)
    return value


@line
def bin_row(row, step, pixels, cells, total):
    """Write a row of cells, the sums over their wanted pixels; `total`, of LANES · step or more, is scratch.

    LANES cells are `step` whole vectors of pixels wide. Cells without a wanted pixel, now and at the last time, are 0.
    """
    first_row, right = (row - MARGIN) * step + MARGIN, pixels.wanted.shape[2] - MARGIN
    for col in range(MARGIN, cells.wanted.shape[2] - MARGIN, LANES):
        first, number = (col - MARGIN) * step + MARGIN, load(cells.wanted, row, 0, col)
        for i in range(first_row, first_row + step):
            for j in range(first, min(first + step * LANES, right), LANES):
                number += load(pixels.wanted, i, 0, j)
        if lanes_of(number > ZERO) == 0:
            continue
        for values, out in ((pixels.z, cells.z), (pixels.counts, cells.counts), (pixels.exposure, cells.exposure),
                            (pixels.wanted, cells.wanted)):
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
        for col in range(MARGIN, values.shape[2] - MARGIN, LANES):
            if is_asked(least, col, LANES):
                value = full(ZERO)
                for tap in range(len(weights)):
                    value = fma(load(values, row + tap - radius, c, col), weights[tap], value)
                store(total, col, value)
        for col in range(MARGIN, values.shape[2] - MARGIN, LANES):
            if is_asked(least, col, 0):
                value = full(ZERO)
                for tap in range(len(weights)):
                    value = fma(load(total, col + tap - radius), weights[tap], value)
                store(out, c, col, value)


@parallel
def _blur(values: float32[:, :, ::1], weights: float32[::1], totals: float32[:, :, ::1],
          out: float32[:, :, ::1]):
    for turn in prange(len(out)):
        total = totals[get_thread_id()]
        blur_row(values, turn + MARGIN, weights, total[1], total[0], out[turn])


def blur(values, sigma):
    rows, channels, cols = values.shape
    padded_rows, padded_cols = maps.padded_shape(rows, cols)
    padded = np.zeros((padded_rows, channels, padded_cols), np.float32)
    maps.crop(padded, rows, cols)[:] = values
    out = np.empty((rows, channels, padded_cols), np.float32)
    _blur(padded, maps.window_weights(sigma), np.zeros((get_num_threads(), 2, padded_cols), np.float32), out)
    return out[:, :, MARGIN:MARGIN + cols]
