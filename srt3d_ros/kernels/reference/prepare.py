"""A sketch as the iterations want it: `prepare` of `kernels.api`."""

import numpy as np

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.reference.arithmetic import parts


def prepare(sums, photons, equaliser, used, scratch=None):
    """Vectorised over pixels."""
    rows, cols, m = sums.shape
    padded_rows, padded_cols = maps.padded_shape(rows, cols)
    matched, counts = np.zeros((padded_rows, 2 * m, padded_cols)), np.zeros((padded_rows, padded_cols))
    maps.crop(matched, rows, cols)[:] = parts(sums.astype(complex) * equaliser)
    maps.crop(counts, rows, cols)[:] = photons * used.astype(np.float64)
    return matched, counts
