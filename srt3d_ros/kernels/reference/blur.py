"""Sums over cells and windows as products with band matrices."""

import math

import torch


def gaussian(sigma, like):
    """`maps.window_weights`, made on the device of an array: a graph that is being recorded cannot wait for a copy."""
    radius = math.ceil(2.5 * sigma)
    distance = torch.arange(-radius, radius + 1, dtype=like.dtype, device=like.device)
    return torch.exp(distance**2 / (-2 * sigma**2))


def blur(values, weights, step):
    """Σ_ab w_a w_b · cells[i + a, c, j + b] at [i, c, j], cells the sums over `step` × `step` pixels, 0 outside.

    `values` are float32 [rows, C, cols], the result [⌈rows / step⌉, C, ⌈cols / step⌉], and `weights` float32
    [2 · radius + 1], those of `maps.window_weights` for rows and columns of cells.
    """
    rows, _, cols = values.shape
    down, across = _bands(weights, rows, step), _bands(weights, cols, step)
    return torch.tensordot(down, values, 1) @ across.T


def _bands(weights, pixels, step):
    """The weight of each pixel of a line in each cell's window, [⌈pixels / step⌉, pixels]."""
    cell = torch.arange(-(-pixels // step), device=weights.device)[:, None]
    tap = torch.arange(pixels, device=weights.device) // step - cell + len(weights) // 2
    inside = (tap >= 0) & (tap < len(weights))
    return weights[tap.clamp(0, len(weights) - 1)].masked_fill(~inside, 0)
