"""What the steps share: a pixel's statistics as complex numbers z_l, and what makes depths one surface's."""

import numpy as np

from srt3d_ros.kernels.maps import DEPTH, INTENSITY, MAX_STD, SLOPE_COL, SLOPE_ROW, STD

TINY, EPSILON = 1e-12, 1e-6        # photons: added nothing, divided by at least this


def angular(frame) -> np.ndarray:
    """ω_l = 2π k_l / T, radians per bin."""
    return 2 * np.pi * frame.bin_frequencies.astype(np.float64)


def pixel_z(matched, i, j) -> np.ndarray:
    """z_l of pixel (i, j), complex [m]."""
    m = matched.shape[1] // 2
    return matched[i, :m, j].astype(np.float64) + 1j * matched[i, m:, j]


def response_of(z, depth, frame) -> float:
    """Of photons with statistics z to the matched filter at a depth: Σ_l Re(z_l exp(−i ω_l t))."""
    return (z * np.exp(-1j * angular(frame) * depth)).real.sum()


def expected(photons, depth, frame) -> np.ndarray:
    """The z of this many photons from a surface at a depth: photons · |ĥ_l|² exp(i ω_l t)."""
    return photons * frame.energy * np.exp(1j * angular(frame) * depth)


def noise_ratio(frame, depth):
    """By how much scores at these depths exceed standard deviations: `clutter` at the nearest bin."""
    return 1.0 if frame.clutter is None else frame.clutter[np.rint(depth).astype(np.int64) % frame.num_bins]


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
