"""The end of a reconstruction: `finalise`, `collect` and `unpack` of `kernels.api`."""

import numpy as np

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import FAINTEST, LEAST_SHARE, SHARE_WINDOW
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, RESIDUAL, SCORE, SLOPE_COL, SLOPE_ROW, STD, VALUE, window_weights
from srt3d_ros.kernels.reference.arithmetic import EPSILON, TINY, noise_ratio
from srt3d_ros.kernels.reference.search import blur


def finalise(frame, photons, state, terms, enough, scratch=None):
    view = maps.crop(state, *frame.shape).astype(float)
    score = view[:, :, SCORE] / noise_ratio(frame, view[:, :, DEPTH])
    kept = (score > enough) & (view[:, :, INTENSITY] > 0)
    intensity = np.where(kept, _shared_intensity(frame, view, terms), 0)
    intensity[intensity < FAINTEST * intensity.max(axis=1, keepdims=True)] = 0
    std = np.clip(np.hypot(view[:, :, STD], view[:, :, RESIDUAL]), EPSILON, frame.num_bins)
    seen = (intensity * maps.crop(frame.exposure, *frame.shape)[:, None]).sum(axis=1)
    return intensity, std, np.maximum(photons.astype(float) - seen, 0)


def _shared_intensity(frame, view, terms):
    """Between the pooled intensity and a pixel's own, which counts as far as pixels truly differ [rows, K, cols]."""
    exposure = np.maximum(maps.crop(frame.exposure, *frame.shape), EPSILON)[:, None].astype(float)
    pooled = view[:, :, INTENSITY]
    seen = pooled > 0
    own = maps.crop(terms, *frame.shape)[:, :, VALUE] / (frame.total_energy * exposure)
    excess = (own - pooled) * seen
    background = np.maximum(maps.crop(frame.counts, *frame.shape)[:, None] - pooled * exposure, 0)
    signal_moment, background_moment = frame.intensity_moments
    variance = (pooled * exposure * signal_moment + background * background_moment) / frame.total_energy**2
    weights = window_weights(SHARE_WINDOW)
    around, counts = blur(excess**2, weights, 1), blur(variance / exposure**2 * seen, weights, 1)
    differ = np.maximum(around - counts, 0) / np.maximum(around, TINY)
    return np.maximum(pooled + excess * differ, LEAST_SHARE * pooled)


def collect(state, intensity, std, rays, metres_per_bin, metres, num_bins):
    order = np.argsort(-intensity, axis=1, kind="stable")
    row, col, rank = np.nonzero(np.take_along_axis(intensity, order, axis=1).swapaxes(1, 2) > 0)
    layer = order[row, rank, col]
    view = maps.crop(state, *rays.shape[:2])
    depth = view[row, layer, DEPTH, col].astype(np.float64)
    depth = np.where(depth < num_bins, depth, 0)
    xyz = rays[row, col] * (metres_per_bin * depth + metres)[:, None]
    slopes = view[row, layer, SLOPE_ROW, col], view[row, layer, SLOPE_COL, col]
    values = np.stack([depth, intensity[row, layer, col], std[row, layer, col], *slopes])
    row, col, rank = row.astype(np.uint16), col.astype(np.uint16), rank.astype(np.uint8)
    return row, col, rank, values.astype(np.float32), xyz.astype(np.float32)


def unpack(points):
    return points
