"""Sums over cells, pooled over a Gaussian window: `blur` of `kernels.api`."""

import numpy as np

from srt3d_ros.kernels.reference.arithmetic import written


def blur(values, weights, step, out=None):
    """Loop over cells, then over windows of them."""
    rows, channels, cols = values.shape
    radius = len(weights) // 2
    cells = np.zeros((-(-rows // step), channels, -(-cols // step)))
    for i, j in np.ndindex(rows, cols):
        cells[i // step, :, j // step] += values[i, :, j]
    around, pooled = np.pad(cells, ((radius, radius), (0, 0), (radius, radius))), np.empty(cells.shape)
    for i, j in np.ndindex(len(cells), cells.shape[2]):
        window = around[i:i + len(weights), :, j:j + len(weights)]
        pooled[i, :, j] = np.einsum("a,acb,b->c", weights, window, weights)
    return written(pooled, out)
