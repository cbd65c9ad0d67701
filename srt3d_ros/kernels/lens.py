"""Lenses as kernels read them, and their distortion.

A lens is float32 [10]: fx, fy, cx, cy, k1, k2, p1, p2, k3, and the x² + y² up to which a camera sees rays (x, y, 1);
or [4]: the first azimuth and its step, the first elevation and its step, of a scanner. Both are those of
`core.sensor.projection`.
"""


def distorted(x, y, k1, k2, p1, p2, k3):
    """(x', y') of rays (x, y, 1) by plumb-bob distortion: `core.sensor.distortion` has the equation.

    x and y are numbers, arrays or tensors. The code has no constants, whose type would decide that of the result.
    """
    r2, xy = x * x + y * y, x * y
    bend = r2 * (k1 + r2 * (k2 + r2 * k3))
    return x + x * bend + p1 * (xy + xy) + p2 * (r2 + x * x + x * x), \
        y + y * bend + p1 * (r2 + y * y + y * y) + p2 * (xy + xy)
