"""Gradient steps of every point on its own pixel's sketch: `pixelwise` of `kernels.api`."""

import numpy as np

from srt3d_ros.kernels.constants import INTENSITY_RATE
from srt3d_ros.kernels.reference.arithmetic import angular, expected, pixel_z


def pixelwise(frame, table, rate, usual, depth, intensity):
    """Loop over points; all steps start from the points as they came."""
    omega, levels = angular(frame), len(table)
    before_depth, before_intensity = depth.astype(float), intensity.astype(float)
    for i, k, j in np.argwhere(before_intensity > 0):
        g = float(frame.exposure[i, j])
        points = zip(before_depth[i, :, j], before_intensity[i, :, j])
        rest = pixel_z(frame.matched, i, j) - sum(expected(g * r, t, frame) for t, r in points)
        t, r = before_depth[i, k, j], before_intensity[i, k, j]
        d = rest * np.exp(-1j * omega * t)
        share = min(g * r / max(frame.counts[i, j], 1), 1)
        weights = table[int(share * (levels - 1) + 0.5)].astype(float)
        shift = weights[0] @ d.real + weights[1] @ d.imag
        change = weights[2] @ d.real + weights[3] @ d.imag
        grown = r + INTENSITY_RATE * change / g
        signal = g * max(r, grown)
        step = rate * shift * signal / max(signal, usual * g)**2
        depth[i, k, j] = (t + np.clip(step, -frame.resolution_bins, frame.resolution_bins)) % frame.num_bins
        intensity[i, k, j] = max(grown, 0)
