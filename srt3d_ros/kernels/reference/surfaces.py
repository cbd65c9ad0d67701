"""What makes depths one surface's: planes, agreement of two depths, weights by distance."""

import numpy as np

from srt3d_ros.kernels.maps import DEPTH, INTENSITY, MAX_STD, SLOPE_COL, SLOPE_ROW, STD

TINY = 1e-12


def wrap(difference, period):
    """The difference of two depths on a circle."""
    return difference - period * np.rint(difference / period)


def plane_depth(record, dy, dx):
    """Depth of a point's tangent plane, (dy, dx) pixels from the point."""
    return record[DEPTH] + record[SLOPE_COL] * dx + record[SLOPE_ROW] * dy


def agreement(difference, variance):
    """How far depths are one surface's, 0 … 1; `variance` is the sum of what each may be off, squared."""
    return np.maximum(1 - difference**2 / (variance + TINY), 0)


def near(dy, dx, sigma):
    """Gaussian weight by distance, 1 at the centre."""
    return np.exp(-(dx**2 + dy**2) / (2 * sigma**2))


def has_depth(records, period):
    """Which of some surfaces [..., FIELDS] exist, at depths that mean anything."""
    return (records[..., INTENSITY] > 0) & (records[..., STD] < MAX_STD * period)
