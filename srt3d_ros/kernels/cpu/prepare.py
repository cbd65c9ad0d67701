"""A sketch as the iterations want it: matched to the IRF, one plane for each part of each frequency, with margins."""

import numpy as np
from numba import prange

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.cpu.arithmetic import F32
from srt3d_ros.kernels.cpu.compiling import parallel
from srt3d_ros.kernels.cpu.scratch import borrow
from srt3d_ros.kernels.maps import MARGIN


@parallel
def _prepare(sums, photons, equaliser, used, matched, counts):
    rows, cols, twice = sums.shape
    m, by_row, by_col = twice // 2, min(equaliser.shape[0] - 1, 1), min(equaliser.shape[1] - 1, 1)
    for i in prange(rows):
        a = i * by_row
        for j in range(cols):
            b = j * by_col
            counts[i + MARGIN, j + MARGIN] = F32(photons[i, j]) * used[i, j]
            for l in range(m):
                re, im = sums[i, j, 2 * l], sums[i, j, 2 * l + 1]
                c, d = equaliser[a, b, 2 * l], equaliser[a, b, 2 * l + 1]
                matched[i + MARGIN, l, j + MARGIN] = re * c - im * d
                matched[i + MARGIN, m + l, j + MARGIN] = re * d + im * c


def prepare(sums, photons, equaliser, used, scratch=None):
    """Rows in parallel."""
    rows, cols, m = sums.shape
    padded_rows, padded_cols = maps.padded_shape(rows, cols)
    matched = borrow(scratch, "matched", (padded_rows, 2 * m, padded_cols), True)
    counts = borrow(scratch, "counts", (padded_rows, padded_cols), True)
    _prepare(np.ascontiguousarray(sums).view(np.float32), np.ascontiguousarray(photons), equaliser.view(np.float32),
             used, matched, counts)
    return matched, counts
