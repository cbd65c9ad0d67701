"""Sums over cells of pixels, and Gaussian sums over windows, rows first, then columns."""

import numpy as np
from numba import prange

from srt3d_ros.kernels.cpu.arithmetic import ZERO
from srt3d_ros.kernels.cpu.compiling import line, parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.maps import MARGIN


@parallel
def _bin_cells(matched, counts, exposure, is_open, step, near, out):
    """Sums over the open pixels of cells of a padded sketch, of counts and of exposure; rows of pixels first.

    Rows of cells that are not `near` stay as they are.
    """
    (rows, cols), channels = is_open.shape, matched.shape[1]
    for i in prange(out.shape[0]):
        if not near[i]:
            continue
        total = np.zeros(out.shape[2] * step, np.float32)
        for c in range(out.shape[1]):
            total[:] = ZERO
            for a in range(i * step, min((i + 1) * step, rows)):
                if c < channels:
                    source = matched[MARGIN + a, c, MARGIN:]
                else:
                    source = counts[MARGIN + a, MARGIN:] if c == channels else exposure[MARGIN + a, MARGIN:]
                used = is_open[a]
                for j in range(cols):
                    total[j] += source[j] * used[j]
            cells = out[i, c]
            if step == 2:
                for j in range(len(cells)):
                    cells[j] = total[2 * j] + total[2 * j + 1]
            else:
                cells[:] = ZERO
                for b in range(step):
                    for j in range(len(cells)):
                        cells[j] += total[step * j + b]


@line
def _add_rows(values, c, weights, i, into):
    """Sum a window's rows of channel c, with a margin of zeros at both ends."""
    radius, cols = len(weights) // 2, values.shape[2]
    into[:] = ZERO
    image = into[radius:]
    for tap in range(len(weights)):
        a = i + tap - radius
        if 0 <= a < values.shape[0]:
            weight, source = weights[tap], values[a, c]
            for j in range(cols):
                image[j] += weight * source[j]


@parallel
def _blur(values, weights, squares, squared, needed, out):
    """Windows of cells, of the rows that are `needed`; channel `squared` with the weights' squares."""
    for i in prange(out.shape[0]):
        if not needed[i]:
            continue
        rows = np.empty(out.shape[2] + len(weights) - 1, np.float32)
        for c in range(out.shape[1]):
            taps = squares if c == squared else weights
            _add_rows(values, c, taps, i, rows)
            total = out[i, c]
            total[:] = ZERO
            for tap in range(len(taps)):
                part, weight = rows[tap:], taps[tap]
                for j in range(len(total)):
                    total[j] += weight * part[j]


def blur(values, weights):
    out = np.empty(values.shape, np.float32)
    _blur(values, weights, weights, -1, np.ones(len(values), bool), out)
    return out


def rows_of_pools(wanted, weights, step):
    """Which rows of cells have a wanted pixel, and which are within their windows; bool [cells] each."""
    needed = np.logical_or.reduceat(wanted.any(axis=1), np.arange(0, len(wanted), step))
    around = np.pad(needed, len(weights) // 2)
    return needed, np.lib.stride_tricks.sliding_window_view(around, len(weights)).any(axis=1)


def pool(matched, counts, exposure, is_open, weights, step, needed, near):
    """Channels of `blur` of a padded sketch, of counts by squared weights, and of exposure: of open pixels alone.

    `needed` and `near` are those of `rows_of_pools`; other rows mean nothing.
    """
    (rows, cols), channels = is_open.shape, matched.shape[1]
    shape = -(-rows // step), channels + 2, -(-cols // step)
    cells, out = (borrow(name, shape) for name in ("cells of pools", "pools"))
    _bin_cells(matched, counts, exposure, is_open, step, near, cells)
    _blur(cells, weights, weights**2, channels, needed, out)
    return out
