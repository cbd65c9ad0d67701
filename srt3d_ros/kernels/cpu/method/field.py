"""Fields of a state and of its terms, as unsigned indices (none counts from the end), and how depths compare."""

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.cpu.arithmetic import ONE, ZERO, U
from srt3d_ros.kernels.cpu.compiling import inline
from srt3d_ros.kernels.cpu.vectors import fma, rint

DEPTH, SLOPE_COL, SLOPE_ROW, INTENSITY, STD, SCORE, RESIDUAL = map(U, range(maps.FIELDS))
VALUE, GRADIENT, CURVATURE, SQUARES, COUNTS, EXPOSURE = map(U, range(maps.TERMS))


@inline
def wrap(difference, period):
    """The difference of two depths on a circle, in [−period/2, period/2]."""
    return fma(rint(difference * (ONE / period)), -period, difference)


@inline
def rise(slope_col, slope_row, dx, dy):
    """How much deeper a tangent plane is dx pixels to the right and dy down, bins."""
    return slope_col * dx + slope_row * dy


@inline
def agreement(e, tolerance):
    """(1 − e² / tolerance)₊: how well two depths e bins apart agree, from 1 at e = 0 to 0 at e² = tolerance."""
    return max(ONE - e * e / tolerance, ZERO)


@inline
def is_surface(intensity, std, max_std):
    """Whether there is a surface whose depth is known."""
    return (intensity > ZERO) & (std < max_std)
