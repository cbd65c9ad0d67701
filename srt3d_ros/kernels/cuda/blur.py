"""Sums over cells and windows as products with band matrices, by torch."""

import torch


def blur(values, weights, step):
    rows, _, cols = values.shape
    down, across = _bands(weights, rows, step), _bands(weights, cols, step)
    return torch.tensordot(down, values, 1) @ across.T


def _bands(weights, pixels, step):
    """The weight of each pixel of a line in each cell's window, [⌈pixels / step⌉, pixels]."""
    cell = torch.arange(-(-pixels // step), device=weights.device)[:, None]
    tap = torch.arange(pixels, device=weights.device) // step - cell + len(weights) // 2
    inside = (tap >= 0) & (tap < len(weights))
    return weights[tap.clamp(0, len(weights) - 1)].masked_fill(~inside, 0)
