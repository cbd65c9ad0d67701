"""Pools: values summed over a Gaussian window, rows first, then columns, row by row of the result."""

import numpy as np
from numba import prange

from srt3d_ros.core.layout import MARGIN
from srt3d_ros.kernels.cpu.arithmetic import ONE, ZERO
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel
from srt3d_ros.kernels.cpu.scratch import borrow


@line
def _add_rows(values, c, mask, weights, step, i, top, left, into):
    """Sum a window's rows of channel c of a map [rows', C, cols'], whose image begins at row `top`, column `left`."""
    radius, cols = (len(weights) - step) // 2, mask.shape[1]
    into[:] = ZERO
    image = into[radius:]
    for tap in range(len(weights)):
        a = i * step + tap - radius
        if 0 <= a < mask.shape[0]:
            weight, source, used = weights[tap], values[top + a, c, left:], mask[a]
            for j in range(cols):
                image[j] += weight * source[j] * used[j]


@line
def _add_cols(rows, weights, step, into):
    """Sum the windows' columns of what `_add_rows` left."""
    into[:] = ZERO
    for tap in range(len(weights)):
        part, weight = rows[tap:], weights[tap]
        if step == 1:
            for j in range(len(into)):
                into[j] += weight * part[j]
        else:
            for j in range(len(into)):
                into[j] += weight * part[j * step]


@inline
def _room(weights, step, cols):
    """Columns of a line that `_add_cols` reads."""
    return -(-cols // step) * step + len(weights) - step


@parallel
def _blur(values, mask, weights, step, out):
    for i in prange(out.shape[0]):
        rows = np.empty(_room(weights, step, mask.shape[1]), np.float32)
        for c in range(out.shape[1]):
            _add_rows(values, c, mask, weights, step, i, 0, 0, rows)
            _add_cols(rows, weights, step, out[i, c])


def blur(values, weights, step):
    """Σ weights · values over a window around every block of `step` × `step` pixels; zero outside the image.

    Args:
        values: float32 [rows, C, cols].
        weights: float32 [2 · radius + step], for rows and for columns, centred on the block.

    Returns:
        float32 [⌈rows / step⌉, C, ⌈cols / step⌉].
    """
    rows, channels, cols = values.shape
    out = np.empty((-(-rows // step), channels, -(-cols // step)), np.float32)
    _blur(values, np.full((rows, cols), ONE), weights, step, out)
    return out


@parallel
def _pool(matched, noise, exposure, mask, weights, squares, step, sums, photons, light):
    for i in prange(sums.shape[0]):
        rows = np.empty(_room(weights, step, mask.shape[1]), np.float32)
        for c in range(sums.shape[1]):
            _add_rows(matched, c, mask, weights, step, i, MARGIN, MARGIN, rows)
            _add_cols(rows, weights, step, sums[i, c])
        _add_rows(noise, 0, mask, squares, step, i, MARGIN, MARGIN, rows)
        _add_cols(rows, squares, step, photons[i])
        _add_rows(exposure, 0, mask, weights, step, i, MARGIN, MARGIN, rows)
        _add_cols(rows, weights, step, light[i])


def pool(matched, noise, exposure, mask, weights, step, scratch=None):
    """Pools of a padded frame's maps: `blur` of matched and exposure, and of noise with the squares of the weights.

    Args:
        matched, noise, exposure: float32 [rows', 2m, cols'] and [rows', cols'].
        mask: float32 [rows, cols], with which pixels are multiplied.
        weights, step: as of `blur`.
        scratch: where results may lie until the next call.
    """
    rows, cols = mask.shape
    size = -(-rows // step), -(-cols // step)
    out = (borrow(scratch, "pooled sketches", (size[0], matched.shape[1], size[1])),
           borrow(scratch, "pooled noise", size), borrow(scratch, "pooled exposure", size))
    _pool(matched, noise[:, None], exposure[:, None], mask, weights, weights**2, step, *out)
    return out
