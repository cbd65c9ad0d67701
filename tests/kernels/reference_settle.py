"""The end of a reconstruction in plain float64 NumPy: a part of `reference`."""

import numpy as np

from srt3d_ros.core import layout
from srt3d_ros.core.layout import DEPTH, INTENSITY, SCORE, SLOPE_COL, SLOPE_ROW, STD
from srt3d_ros.kernels.constants import FAINTEST, LEAST_SHARE, SHARE_WINDOW

from .reference_start import blur


def shared_intensity(data, state, own):
    """Between the pooled intensity and a pixel's own, which counts as far as pixels truly differ [rows, K, cols]."""
    exposure = np.maximum(layout.crop(data.exposure, *data.shape), 1e-6)[:, None].astype(float)
    pooled = layout.crop(state, *data.shape)[:, :, INTENSITY].astype(float)
    seen = pooled > 0
    excess = (layout.crop(own, *data.shape) - pooled) * seen
    background = np.maximum(layout.crop(data.noise, *data.shape)[:, None] - pooled * exposure, 0)
    signal_moment, background_moment = data.intensity_moments
    variance = (pooled * exposure * signal_moment + background * background_moment) / data.total_energy**2
    weights = np.exp(-np.arange(-5, 6)**2 / (2 * SHARE_WINDOW**2))
    around, noise = blur(excess**2, weights, 1), blur(variance / exposure**2 * seen, weights, 1)
    differ = np.maximum(around - noise, 0) / np.maximum(around, 1e-12)
    return np.maximum(pooled + excess * differ, LEAST_SHARE * pooled)


def settled(data, photons, state, own, bent, enough):
    """What `settle` returns, from the own intensities and the relief."""
    view = layout.crop(state, *data.shape).astype(float)
    score = view[:, :, SCORE] / data.noise_ratio(view[:, :, DEPTH])
    kept = (score > enough) & (view[:, :, INTENSITY] > 0)
    intensity = np.where(kept, shared_intensity(data, state, own), 0)
    intensity[intensity < FAINTEST * intensity.max(axis=1, keepdims=True)] = 0
    std = np.clip(np.hypot(view[:, :, STD], layout.crop(bent, *data.shape)), 1e-6, data.num_bins)
    seen = (intensity * layout.crop(data.exposure, *data.shape)[:, None]).sum(axis=1)
    return intensity, std, np.maximum(photons.astype(float) - seen, 0)


def collect(state, intensity, std, rays, metres_per_bin, metres, num_bins):
    order = np.argsort(-intensity, axis=1, kind="stable")
    row, col, rank = np.nonzero(np.take_along_axis(intensity, order, axis=1).swapaxes(1, 2) > 0)
    layer = order[row, rank, col]
    view = layout.crop(state, *rays.shape[:2])
    depth = view[row, layer, DEPTH, col]
    depth = np.where(depth < num_bins, depth, 0)
    xyz = rays[row, col] * (metres_per_bin * depth + metres)[:, None]
    slopes = view[row, layer, SLOPE_ROW, col], view[row, layer, SLOPE_COL, col]
    values = np.stack([depth, intensity[row, layer, col], std[row, layer, col], *slopes])
    return row.astype(np.uint16), col.astype(np.uint16), rank.astype(np.uint8), values.astype(np.float32), xyz
