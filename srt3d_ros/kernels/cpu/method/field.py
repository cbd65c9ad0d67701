"""A state's fields: their indices, unsigned, so that no index counts from the end, and what depths have in common."""

import numpy as np

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.cpu.arithmetic import ONE, ZERO, U
from srt3d_ros.kernels.cpu.compiling import inline

DEPTH, SLOPE_COL, SLOPE_ROW, INTENSITY, STD, SCORE, RESIDUAL = map(U, range(maps.FIELDS))
VALUE, GRADIENT, CURVATURE, SQUARES, COUNTS, EXPOSURE = map(U, range(maps.TERMS))


@inline
def wrap(difference, period):
    """The difference of two depths on a circle, in [−period/2, period/2]."""
    return difference - period * np.rint(difference * (ONE / period))


@inline
def rise(slope_col, slope_row, dx, dy):
    """How much deeper a tangent plane is at (dx, dy) pixels, bins."""
    return slope_col * dx + slope_row * dy


@inline
def agreement(e, tolerance):
    """How far two depths e bins apart are one surface's: 1 at e = 0, 0 from e² = tolerance on."""
    return max(ONE - e * e / tolerance, ZERO)


@inline
def is_surface(intensity, std, max_std):
    """Whether there is a surface, at a depth that means anything."""
    return (intensity > ZERO) & (std < max_std)
