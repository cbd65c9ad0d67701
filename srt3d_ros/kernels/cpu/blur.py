"""Pools: values summed over a Gaussian window, rows first, then columns."""

import numpy as np
from numba import prange

from srt3d_ros.kernels.cpu.arithmetic import ONE, ZERO, parallel
from srt3d_ros.kernels.cpu.scratch import borrow


@parallel
def _blur_rows(values, mask, weights, step, top, left, out):
    radius = (len(weights) - step) // 2
    tall, channels, cols = out.shape
    rows = min(mask.shape[0], values.shape[0] - top)
    for i in prange(tall):
        out[i] = ZERO
        for tap in range(len(weights)):
            a = i * step + tap - radius
            if 0 <= a < rows:
                for c in range(channels):
                    line, used, into, weight = values[top + a, c, left:], mask[a], out[i, c], weights[tap]
                    for j in range(cols):
                        into[j] += weight * line[j] * used[j]


@parallel
def _blur_cols(values, weights, step, out):
    radius = (len(weights) - step) // 2
    rows, channels, cols = values.shape
    for i in prange(rows):
        line = np.zeros(out.shape[2] * step + 2 * radius, np.float32)
        for c in range(channels):
            line[radius:radius + cols] = values[i, c]
            into = out[i, c]
            into[:] = ZERO
            for tap in range(len(weights)):
                part, weight = line[tap:], weights[tap]
                for j in range(len(into)):
                    into[j] += weight * part[j * step]


def pool(values, mask, weights, step, top, left, cols, scratch=None, name=""):
    """As `blur`, of a part of a map and with a mask.

    Args:
        values: float32 [rows', C, cols'], of which the image begins at row `top`, column `left`.
        mask: float32 [rows, cols], with which pixels are multiplied.
        weights, step: as of `blur`.
        scratch, name: where results may lie until the next call.
    """
    rows, channels = mask.shape[0], values.shape[1]
    tall = borrow(scratch, name + "tall", (-(-rows // step), channels, cols))
    out = borrow(scratch, name + "pool", (tall.shape[0], channels, -(-cols // step)))
    _blur_rows(values, mask, weights, step, top, left, tall)
    _blur_cols(tall, weights, step, out)
    return out


def blur(values, weights, step):
    """Σ weights · values over a window around every block of `step` × `step` pixels; zero outside the image.

    Args:
        values: float32 [rows, C, cols].
        weights: float32 [2 · radius + step], for rows and for columns, centred on the block.

    Returns:
        float32 [⌈rows / step⌉, C, ⌈cols / step⌉].
    """
    rows, _, cols = values.shape
    return pool(values, np.full((rows, cols), ONE), weights, step, 0, 0, cols)
