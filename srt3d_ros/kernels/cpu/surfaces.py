"""What it means that two depths are of one surface: said once, for all kernels of the CPU."""

from srt3d_ros.kernels.cpu.arithmetic import ONE, ZERO, wrap
from srt3d_ros.kernels.cpu.compiling import inline


@inline
def rise(slope_col, slope_row, dx, dy):
    """How much deeper a tangent plane is at (dx, dy) pixels, bins."""
    return slope_col * dx + slope_row * dy


@inline
def distance(depth, other, period):
    """Signed difference of two depths on the circle, bins."""
    return wrap(depth - other, period)


@inline
def agreement(e, tolerance):
    """How far two depths e bins apart are one surface's: 1 at e = 0, 0 from e² = tolerance on."""
    return max(ONE - e * e / tolerance, ZERO)


@inline
def is_surface(intensity, std, max_std):
    """Whether there is a surface, at a depth that means anything."""
    return (intensity > ZERO) & (std < max_std)
