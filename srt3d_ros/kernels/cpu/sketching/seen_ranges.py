"""How far a camera sees points that were seen from elsewhere: `seen_ranges`."""

import numpy as np

from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO
from srt3d_ros.kernels.cpu.compiling import Kernel, floats2d
from srt3d_ros.kernels.cpu.sketching.move_sketch import LENSES, Motion, norm, place

NOTHING = F32(np.inf)


@Kernel
def _see(xyz: floats2d, motion: Motion, lens: LENSES, ranges: floats2d):
    (rows, cols), turn, offset = ranges.shape, motion.rotation, motion.offset
    for n in range(len(xyz)):
        p, q, r = xyz[n, 0], xyz[n, 1], xyz[n, 2]
        x = turn[0, 0] * p + turn[0, 1] * q + turn[0, 2] * r + offset[0]
        y = turn[1, 0] * p + turn[1, 1] * q + turn[1, 2] * r + offset[1]
        z = turn[2, 0] * p + turn[2, 1] * q + turn[2, 2] * r + offset[2]
        row, col = place(x, y, z, lens)
        if row > -ONE and row < F32(rows) and col > -ONE and col < F32(cols):
            above, left, length = np.int64(np.floor(row)), np.int64(np.floor(col)), norm(x, y, z)
            for i in range(max(above, 0), min(above + 2, rows)):
                for j in range(max(left, 0), min(left + 2, cols)):
                    ranges[i, j] = min(ranges[i, j], length)


@Kernel
def _fill(ranges: floats2d):
    """Give each hole the mean of its known neighbours: row by row, those before it; then backwards, those after it."""
    rows, cols = ranges.shape
    for turn in range(2):
        step = 1 - 2 * turn
        for n in range(rows * cols):
            i, j = divmod(n if turn == 0 else rows * cols - 1 - n, cols)
            if ranges[i, j] == NOTHING:
                total, number = ZERO, ZERO
                for k in range(4):
                    y, x = i - step * (k > 0), j + step * (k - 2 if k > 0 else -1)
                    if y >= 0 and y < rows and x >= 0 and x < cols and ranges[y, x] < NOTHING:
                        total, number = total + ranges[y, x], number + ONE
                if number > ZERO:
                    ranges[i, j] = total / number


def seen_ranges(xyz, motion, lens, shape):
    """The range along each pixel's ray at which points are seen after a motion, float32 [rows, cols], metres.

    The four pixels around the place of a point see it; of several points, a pixel sees the nearest. Pixels without one
    get the mean of neighbours; all are infinite if none sees a point.

    Args:
        xyz: float32 [N, 3], metres, before the motion.
        motion: `Motion`.
        lens: of `kernels.lens`.
        shape: rows, cols.
    """
    ranges = np.full(shape, NOTHING, np.float32)
    _see(xyz, motion, tuple(lens), ranges)
    _fill(ranges)
    return ranges
