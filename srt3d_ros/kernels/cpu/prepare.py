"""A sketch as the iterations want it: matched to the IRF, one plane for each part of each frequency, with margins."""

import numpy as np
from numba import prange

from srt3d_ros.core import layout
from srt3d_ros.core.layout import MARGIN
from srt3d_ros.kernels.cpu.arithmetic import F32
from srt3d_ros.kernels.cpu.compiling import parallel
from srt3d_ros.kernels.cpu.scratch import borrow


@parallel
def _prepare(sums, photons, equaliser, used, matched, noise):
    rows, cols, twice = sums.shape
    m, by_row, by_col = twice // 2, min(equaliser.shape[0] - 1, 1), min(equaliser.shape[1] - 1, 1)
    for i in prange(rows):
        a = i * by_row
        for j in range(cols):
            b = j * by_col
            noise[i + MARGIN, j + MARGIN] = F32(photons[i, j]) * used[i, j]
            for l in range(m):
                re, im = sums[i, j, 2 * l], sums[i, j, 2 * l + 1]
                c, d = equaliser[a, b, 2 * l], equaliser[a, b, 2 * l + 1]
                matched[i + MARGIN, l, j + MARGIN] = re * c - im * d
                matched[i + MARGIN, m + l, j + MARGIN] = re * d + im * c


def prepare(sums, photons, equaliser, used, scratch=None):
    """`Frame.matched` and `Frame.noise` of a sketch, padded.

    Args:
        sums: complex64 [rows, cols, m], of `Sketch`.
        photons: uint32 [rows, cols].
        equaliser: complex64 [rows or 1, cols or 1, m], conj(ĥ_l) with all that is known of a pixel; 0 masks it.
        used: float32 [rows, cols], 0 in masked pixels, else 1.
        scratch: where results may lie until the next call.

    Returns:
        float32 [rows', 2m, cols'] and [rows', cols'].
    """
    rows, cols, m = sums.shape
    tall, wide = layout.padded_shape(rows, cols)
    matched, noise = borrow(scratch, "matched", (tall, 2 * m, wide), True), borrow(scratch, "noise", (tall, wide), True)
    _prepare(np.ascontiguousarray(sums).view(np.float32), np.ascontiguousarray(photons), equaliser.view(np.float32),
             used, matched, noise)
    return matched, noise
