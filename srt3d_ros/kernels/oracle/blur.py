"""Sums over cells and windows as products with band matrices."""

from functools import lru_cache

import numpy as np
import torch


def blur(values, weights):
    """Σ_ab w_a w_b · values[i + a, c, j + b] at [i, c, j], 0 outside.

    `values` and the result are float32 [rows, C, cols], and `weights` NumPy's, float32 [2 · radius + 1].
    """
    return blur_cells(values, weights, 1)


def blur_cells(values, weights, step):
    """The same of sums over cells of `step` × `step` pixels, [⌈rows / step⌉, C, ⌈cols / step⌉]."""
    rows, _, cols = values.shape
    down, across = (_bands(weights.tobytes(), pixels, step, values.dtype, values.device) for pixels in (rows, cols))
    return torch.tensordot(down, values, 1) @ across.T


@lru_cache(maxsize=None)        # a graph that is being recorded cannot wait for a copy, and reads them while it lives
def _bands(weights, pixels, step, dtype, device):
    """The weight of each pixel of a line in each cell's window, [⌈pixels / step⌉, pixels]."""
    weights = np.frombuffer(weights, np.float32)
    tap = np.arange(pixels) // step - np.arange(-(-pixels // step))[:, None] + len(weights) // 2
    inside = (tap >= 0) & (tap < len(weights))
    return torch.from_numpy(np.where(inside, weights[tap.clip(0, len(weights) - 1)], 0)).to(device, dtype)
