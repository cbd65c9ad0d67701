"""The end of a reconstruction: `collect` and `unexplained`.

How many points there are only the device knows, so their list has room for all that there can be.
"""

import numpy as np
import torch

from srt3d_ros.kernels.constants import EPSILON, TINY
from srt3d_ros.kernels.maps import DEPTH, SLOPE_COL, SLOPE_ROW, crop
from srt3d_ros.kernels.torch.arithmetic import waves
from srt3d_ros.kernels.torch.fusing import fused


@fused
def collect(state, intensity, std, rays, metres_per_bin, metres, num_bins):
    """The points as `unpack` reads them, by pixel, the strongest first: xyz = ray · (metres_per_bin · t + metres).

    `intensity` and `std` are those of `finalise`, `rays` unit vectors, float32 [rows, cols, 3].
    """
    rows, surfaces, cols = intensity.shape
    view, there = crop(state, rows, cols), intensity > 0
    k, row, col = (torch.arange(size, device=intensity.device) for size in (surfaces, rows, cols))
    rank = torch.zeros_like(there, dtype=torch.int64)       # how many of the pixel's points are stronger
    for q in range(surfaces):
        other = intensity[:, q:q + 1]
        rank += (other > intensity) | ((other == intensity) & (k[:, None] > q))
    number = there.sum(dim=1)
    end = number.flatten().cumsum(0)
    place = ((end.view(rows, cols) - number)[:, None] + rank).masked_fill(~there, intensity.numel())

    depth = view[:, :, DEPTH]
    depth = depth.masked_fill(depth >= num_bins, 0)         # where rounding made it T
    xyz = rays.movedim(2, 0)[:, :, None] * (depth * metres_per_bin + metres)
    where = (values.expand_as(depth).to(depth.dtype) for values in (row[:, None, None], col, rank))
    points = torch.stack([depth, intensity, std, view[:, :, SLOPE_ROW], view[:, :, SLOPE_COL], *xyz, *where], dim=-1)
    packed = points.new_zeros(intensity.numel() + 1, points.shape[-1])
    return packed.index_put((place.flatten(),), points.flatten(0, 2)), end[-1:]


def unpacked(points: np.ndarray) -> tuple:
    """Of points [N, 11]: row, column, uint16 [N]; rank in the pixel, uint8 [N]; values; xyz.

    Values, float32 [5, N], are depth (bins), intensity (photons), standard deviation (bins), slopes down and to the
    right (bins per pixel). xyz is float32 [N, 3], metres.
    """
    values, xyz, where = np.split(points.astype(np.float32, copy=False), [5, 8], axis=1)
    row, col, rank = where.T
    return (row.astype(np.uint16), col.astype(np.uint16), rank.astype(np.uint8), np.ascontiguousarray(values.T),
            np.ascontiguousarray(xyz))


@fused
def unexplained(frame, state, intensity, own, taken, background, photons, passed):
    """What points leave of a frame, as far as it may be background; y = g Σ_k r_k exp(i ω_l t_k), w = b̄ / n̄.

    Args:
        intensity: of `finalise`, r.
        own, taken: float32 [rows, cols], background photons: of `finalise`, and as subtracted before; 0 in masked
            pixels.
        background, photons: float32 [rows, cols], b̄ and n̄: own and n, averaged over a window.
        passed: complex [rows or 1, cols or 1, m], q_l: a background photon adds q_l · exp(i ω_l x) to z_l.

    Returns:
        float32 [4m + 4], sums over the pixels: of w conj(q_l) (z_l − |ĥ_l|² y_l), real parts before imaginary ones;
        of w y_l in the same way; of w · own, w · taken, w² n and Σ_l |z_l − |ĥ_l|² y_l|² / |ĥ_l|² n̄.
    """
    counts, light, depth, matched = (crop(values, *frame.shape) for values in (
        frame.counts, frame.exposure, state[:, :, DEPTH], frame.matched))
    gives, energy = (intensity * light[:, None])[:, :, None], frame.energy[:, None]
    points = [(gives * wave).sum(dim=1) for wave in waves(frame, depth)]                       # [rows, m, cols] each
    re, im = (z - energy * part for z, part in zip(matched.chunk(2, dim=1), points))
    around = photons.clamp(min=EPSILON)
    share = background / around
    misfit = ((re**2 + im**2) / energy.clamp(min=TINY) / around[:, None]).sum()
    q_re, q_im = passed.movedim(2, 1).unbind(-1)
    maps = q_re * re + q_im * im, q_re * im - q_im * re, *points
    sums = [(share * own).sum(), (share * taken).sum(), (share**2 * counts).sum(), misfit]
    return torch.cat([*((share[:, None] * values).sum(dim=(0, 2)) for values in maps), torch.stack(sums)])
