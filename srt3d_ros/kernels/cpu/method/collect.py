"""The list of the points of a frame: `collect`."""

import numpy as np
from numba import float32, float64, int64, prange, uint8, uint16

from srt3d_ros.kernels.cpu.arithmetic import ZERO
from srt3d_ros.kernels.cpu.compiling import floats2d, floats3d, line, parallel, read_only

MAP, RAYS = read_only(float32[:, :, :]), read_only(floats3d)


@line
def _rank(intensity, i, k, j):
    """How many surfaces of the pixel come before surface k: the stronger ones, of equals those with a lower index."""
    rank = 0
    for other in range(intensity.shape[1]):
        more = intensity[i, other, j] - intensity[i, k, j]
        rank += more > 0 or (more == 0 and other < k)
    return rank


@parallel
def _collect(depth: MAP, intensity: MAP, std: MAP, rays: RAYS, first: int64[::1], scale: float64[::1], row: uint16[::1],
             col: uint16[::1], rank: uint8[::1], values: floats2d, xyz: floats2d):
    """Write the points of each row of pixels from place `first` on; `scale` is metres_per_bin, metres, num_bins."""
    for i in prange(len(intensity)):
        place = first[i]
        for j in range(intensity.shape[2]):
            number = 0
            for k in range(intensity.shape[1]):
                if intensity[i, k, j] > 0:
                    at, number = place + _rank(intensity, i, k, j), number + 1
                    t = depth[i, k, j] if depth[i, k, j] < scale[2] else ZERO       # rounded up to T
                    row[at], col[at], rank[at] = i, j, at - place
                    values[0, at], values[1, at], values[2, at] = t, intensity[i, k, j], std[i, k, j]
                    for axis in range(3):
                        xyz[at, axis] = rays[i, j, axis] * (t * scale[0] + scale[1])
            place += number


def collect(depth, intensity, std, rays, metres_per_bin, metres, num_bins):
    of_rows = np.count_nonzero(intensity > 0, axis=(1, 2))
    ends = np.cumsum(of_rows)
    row, col, rank = (np.empty(ends[-1], kind) for kind in (np.uint16, np.uint16, np.uint8))
    values, xyz = np.empty((3, ends[-1]), np.float32), np.empty((ends[-1], 3), np.float32)
    _collect(depth, intensity, std, rays, ends - of_rows, np.array([metres_per_bin, metres, num_bins], float), row, col,
             rank, values, xyz)
    return row, col, rank, values, xyz
