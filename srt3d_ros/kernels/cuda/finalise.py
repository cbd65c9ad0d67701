"""The end of a reconstruction, by torch: which points the photons speak for, how bright and how sure, and their list.

How many points there are only the device knows, so their list has room for all that there can be.
"""

import numpy as np
import torch

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import FAINTEST, LEAST_SHARE, SHARE_WINDOW
from srt3d_ros.kernels.cuda.arithmetic import EPSILON, TINY
from srt3d_ros.kernels.cuda.blur import blur
from srt3d_ros.kernels.cuda.device import constant

SHARE_WEIGHTS = maps.window_weights(SHARE_WINDOW)


def finalise(frame, photons, state, terms, enough, scratch=None):
    view, terms = maps.crop(state, *frame.shape), maps.crop(terms, *frame.shape)
    counts, exposure = (maps.crop(values, *frame.shape)[:, None] for values in (frame.counts, frame.exposure))
    pooled, gain = view[:, :, maps.INTENSITY], frame.total_energy * exposure.clamp(min=EPSILON.value)
    excess = terms[:, :, maps.VALUE] / gain - pooled
    signal = pooled * exposure
    of_signal, of_background = frame.intensity_moments
    variance = (signal * of_signal + (counts - signal).clamp(min=0) * of_background) / gain**2
    nowhere = pooled <= 0
    both = torch.cat([values.masked_fill(nowhere, 0) for values in (excess**2, variance)], dim=1)
    around, noise = blur(both, constant(SHARE_WEIGHTS), 1).chunk(2, dim=1)
    differ = (around - noise).clamp(min=0) / around.clamp(min=TINY.value)
    intensity = torch.maximum(pooled + excess * differ, LEAST_SHARE * pooled)

    score = view[:, :, maps.SCORE]
    if frame.clutter is not None:
        score = score / frame.clutter[view[:, :, maps.DEPTH].round().long() % len(frame.clutter)]
    intensity = intensity.masked_fill(nowhere | (score <= enough), 0)
    strongest = intensity.amax(dim=1, keepdim=True)
    intensity = intensity.masked_fill(intensity < FAINTEST * strongest, 0)
    std = torch.hypot(view[:, :, maps.STD], view[:, :, maps.RESIDUAL]).clamp(EPSILON.value, frame.num_bins)
    background = photons.to(torch.float32) - (intensity * exposure).sum(dim=1)
    return intensity, std, background.clamp(min=0)


def collect(state, intensity, std, rays, metres_per_bin, metres, num_bins):
    """One tensor, float32 [11, rows · K · cols + 1], whose last column begins with the number of points, int32."""
    rows, surfaces, cols = intensity.shape
    view, there = maps.crop(state, rows, cols), intensity > 0
    k, row, col = (torch.arange(size, device=intensity.device) for size in (surfaces, rows, cols))
    rank = torch.zeros_like(there, dtype=torch.int64)       # how many of the pixel's points are stronger
    for q in range(surfaces):
        other = intensity[:, q:q + 1]
        rank += (other > intensity) | ((other == intensity) & (k[:, None] > q))
    number = there.sum(dim=1)
    end = number.flatten().cumsum(0)
    place = ((end.view(rows, cols) - number)[:, None] + rank).masked_fill(~there, intensity.numel())

    depth = view[:, :, maps.DEPTH]
    depth = depth.masked_fill(depth >= num_bins, 0)         # where rounding made it T
    xyz = rays.movedim(2, 0)[:, :, None] * (depth * metres_per_bin + metres)
    where = (values.expand_as(depth).to(torch.float32) for values in (row[:, None, None], col, rank))
    points = torch.stack([depth, intensity, std, view[:, :, maps.SLOPE_ROW], view[:, :, maps.SLOPE_COL], *xyz, *where])
    packed = points.new_empty(len(points), intensity.numel() + 1)
    packed[:, place.flatten()] = points.flatten(1)
    packed[0, -1:] = end[-1:].to(torch.int32).view(torch.float32)
    return packed,


def unpack(points):
    packed = points[0].cpu().numpy()
    number = packed[0, -1:].view(np.int32)[0]
    values, xyz, (row, col, rank) = np.split(packed[:, :number], [5, 8])
    return row.astype(np.uint16), col.astype(np.uint16), rank.astype(np.uint8), values, np.ascontiguousarray(xyz.T)
