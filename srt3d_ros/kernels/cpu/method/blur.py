"""Sums over cells of pixels, and Gaussian sums Σ_ab w_a w_b · values[i + a, c, j + b]: over rows, then columns."""

import numpy as np
from numba import boolean, float32, int64, prange

from srt3d_ros.kernels.cpu.arithmetic import ZERO
from srt3d_ros.kernels.cpu.compiling import line, parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.maps import MARGIN, window_weights


@parallel
def _bin_cells(matched: float32[:, :, ::1], counts: float32[:, ::1], exposure: float32[:, ::1],
               is_open: float32[:, ::1], step: int64, near: boolean[::1], out: float32[:, :, ::1]):
    """Sum a padded sketch, counts and exposure over the open pixels of each cell: its rows, then its columns.

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
    """Write the sums over a window's rows of channel c, with zeros as a margin at both ends."""
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
def _blur(values: float32[:, :, ::1], weights: float32[::1], squares: float32[::1], squared: int64,
          needed: boolean[::1], out: float32[:, :, ::1]):
    """Write the windows in the rows that are `needed`; those of channel `squared` have `squares` as weights."""
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


def blur(values, sigma):
    out, weights = np.empty(values.shape, np.float32), window_weights(sigma)
    _blur(values, weights, weights, -1, np.ones(len(values), bool), out)
    return out


def rows_of_pools(wanted, weights, step):
    """Which rows of cells have a wanted pixel, and which are within the windows around these; bool [cells] each."""
    needed = np.logical_or.reduceat(wanted.any(axis=1), np.arange(0, len(wanted), step))
    around = np.pad(needed, len(weights) // 2)
    return needed, np.lib.stride_tricks.sliding_window_view(around, len(weights)).any(axis=1)


def pool(frame, matched, wanted, weights, step):
    """Sums over the wanted pixels of cells, and windows of these: of the sketch, counts and exposure.

    Windows of counts are weighted by squares. Rows of windows without a wanted pixel hold no values.

    Returns:
        float32 [cells, 2m + 2, cells] each.
    """
    (rows, cols), channels = wanted.shape, matched.shape[1]
    cells = borrow("cells of pools", (-(-rows // step), channels + 2, -(-cols // step)))
    needed, near = rows_of_pools(wanted, weights, step)
    _bin_cells(matched, frame.counts, frame.exposure, wanted.astype(np.float32), step, near, cells)
    if len(weights) == 1:
        return cells, cells
    out = borrow("pools", cells.shape)
    _blur(cells, weights, weights**2, channels, needed, out)
    return cells, out
