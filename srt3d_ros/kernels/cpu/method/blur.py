"""Sums over cells of pixels, and Gaussian sums Σ_ab w_a w_b · values[i + a, c, j + b]: over rows, then columns.

Maps are padded (`kernels.maps`), so that windows need no bounds checks.
"""

from typing import NamedTuple

import numpy as np
from numba import float32, get_num_threads, get_thread_id, int64, prange

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
def _add_columns(total, first, step):
    """The sums of every `step` numbers from `first` on."""
    value = full(ZERO)
    for b in range(step):
        value += gather(total, lane_numbers() * step + (first + b))
    return value


@line
def _add_cells(values, wanted, row, step, total, out):
    """Write a row of cells: the sums of its rows of pixels, then of its columns."""
    first = (row - MARGIN) * step + MARGIN
    for c in range(values.shape[1]):
        total[:] = ZERO
        for col in range(MARGIN, values.shape[2] - MARGIN, LANES):
            value = full(ZERO)
            for a in range(first, first + step):
                value = fma(load(values, a, c, col), load(wanted, a, 0, col), value)
            store(total, col, value)
        for col in range(MARGIN, out.shape[2] - MARGIN, LANES):
            at = (col - MARGIN) * step + MARGIN
            if step == 1:       # a known step makes fast code
                store(out, row, c, col, load(total, at))
            elif step == 2:
                store(out, row, c, col, _add_columns(total, at, 2))
            else:
                store(out, row, c, col, _add_columns(total, at, step))


@parallel
def _bin_cells(pixels: Cells, step: int64, totals: float32[:, ::1], cells: Cells):
    """Sum the wanted pixels of each cell."""
    for turn in prange(len(cells.z) - 2 * MARGIN):
        row, total = turn + MARGIN, totals[get_thread_id()]
        _add_cells(pixels.z, pixels.wanted, row, step, total, cells.z)
        _add_cells(pixels.counts, pixels.wanted, row, step, total, cells.counts)
        _add_cells(pixels.exposure, pixels.wanted, row, step, total, cells.exposure)
        _add_cells(pixels.wanted, pixels.wanted, row, step, total, cells.wanted)


def bin_cells(pixels: Cells, step, totals, cells: Cells) -> None:
    """Sum the wanted pixels of each cell; `totals` [threads, 2 · cols'] is scratch."""
    _bin_cells(pixels, step, totals, cells)


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
