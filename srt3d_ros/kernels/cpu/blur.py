"""Sums over cells of pixels, and Gaussian sums over windows, rows first, then columns."""

import numpy as np
from numba import prange

from srt3d_ros.kernels.cpu.arithmetic import ZERO
from srt3d_ros.kernels.cpu.compiling import line, parallel
from srt3d_ros.kernels.cpu.scratch import borrow


@parallel
def _bin_cells(values, mask, top, step, out):
    """Sums over cells, rows first."""
    rows, cols = mask.shape
    for i in prange(out.shape[0]):
        total = np.zeros(out.shape[2] * step, np.float32)
        for c in range(out.shape[1]):
            total[:] = ZERO
            for a in range(i * step, min((i + 1) * step, rows)):
                source, used = values[top + a, c, top:], mask[a]
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
def _blur(values, weights, out):
    for i in prange(out.shape[0]):
        rows = np.empty(out.shape[2] + len(weights) - 1, np.float32)
        for c in range(out.shape[1]):
            _add_rows(values, c, weights, i, rows)
            total = out[i, c]
            total[:] = ZERO
            for tap in range(len(weights)):
                part, weight = rows[tap:], weights[tap]
                for j in range(len(total)):
                    total[j] += weight * part[j]


def blur(values, weights, step, out=None):
    """Rows in parallel."""
    rows, _, cols = values.shape
    return pool(values, np.ones((rows, cols), np.float32), weights, step, out=out)


def pool(values, mask, weights, step, scratch=None, name="", out=None):
    """`blur` of mask · values, of maps [rows, C, cols] or [rows', C, cols'].

    Args:
        mask: float32 [rows, cols], of the image in the middle of the maps.
        scratch, name: where results may lie until the next call with this name.
    """
    (rows, cols), top = mask.shape, (values.shape[0] - mask.shape[0]) // 2
    shape = -(-rows // step), values.shape[1], -(-cols // step)
    cells = borrow(scratch, f"cells of {name}", shape)
    _bin_cells(values, mask, top, step, cells)
    out = borrow(scratch, f"pool of {name}", shape) if out is None else out
    _blur(cells, weights, out)
    return out
