"""The end of a reconstruction: which points the photons speak for, how bright and how sure each is, and their list."""

import numpy as np

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import WINDOWS
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, ONE, TINY
from srt3d_ros.kernels.cpu.blur import blur
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, RESIDUAL, SCORE, SLOPE_COL, SLOPE_ROW, STD, VALUE, crop

SHARE_WEIGHTS = maps.window_weights(WINDOWS[0][0])


def finalise(frame, photons, state, terms, enough):
    view = crop(state, *frame.shape)
    counts, exposure = (crop(values, *frame.shape)[:, None] for values in (frame.counts, frame.exposure))
    pooled, gain = view[:, :, INTENSITY], F32(frame.total_energy) * np.maximum(exposure, EPSILON)
    excess, signal = crop(terms, *frame.shape)[:, :, VALUE] / gain - pooled, pooled * np.maximum(exposure, EPSILON)
    variance = signal * frame.intensity_moments[0] + np.maximum(counts - signal, 0) * frame.intensity_moments[1]
    both = np.concatenate([excess * excess, variance / gain**2], axis=1) * np.tile(pooled > 0, (1, 2, 1))
    around, noise = np.split(blur(both, SHARE_WEIGHTS), 2, axis=1)
    differ = ONE - np.minimum(noise / np.maximum(around, TINY), ONE)
    intensity = np.maximum(pooled + excess * differ, EPSILON * pooled)

    score = view[:, :, SCORE]
    if frame.clutter is not None:
        score = score / frame.clutter[np.rint(view[:, :, DEPTH]).astype(np.int32) % frame.num_bins]
    intensity *= (score > F32(enough)) & (pooled > 0)
    std = np.sqrt(view[:, :, STD]**2 + view[:, :, RESIDUAL]**2).clip(EPSILON, F32(frame.num_bins))
    background = photons.astype(np.float32) - (intensity * exposure).sum(axis=1)
    return intensity, std, np.maximum(background, 0)


def collect(state, intensity, std, rays, metres_per_bin, metres, num_bins):
    rows, surfaces, cols = intensity.shape
    layer = (surfaces * cols * np.arange(rows)[:, None] + np.arange(cols)).reshape(-1)      # where each pixel's lie
    if surfaces > 1:            # the strongest first; of equal ones the first
        order = np.argsort(-intensity, axis=1, kind="stable").swapaxes(1, 2).reshape(-1, surfaces)
        layer = (layer[:, None] + order * cols).reshape(-1)
    place = np.flatnonzero(intensity.take(layer))
    (pixel, rank), at = np.divmod(place, surfaces), layer[place]
    row, col = np.divmod(pixel, cols)
    depth, slope_row, slope_col = (crop(state, rows, cols)[:, :, f].take(at) for f in (DEPTH, SLOPE_ROW, SLOPE_COL))
    depth[depth >= num_bins] = 0                                # where rounding made it T
    values = np.stack([depth, intensity.take(at), std.take(at), slope_row, slope_col])
    xyz = rays.reshape(-1, 3).take(pixel, axis=0) * (depth.astype(float) * metres_per_bin + metres)[:, None]
    return row.astype(np.uint16), col.astype(np.uint16), rank.astype(np.uint8), values, xyz.astype(np.float32)


def unpack(points):
    return points
