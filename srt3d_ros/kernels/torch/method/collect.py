"""The end of a reconstruction: `collect` and `unexplained`.

Only the device knows the number of points, so their list has room for K in every pixel.
"""

import torch

from srt3d_ros.kernels.constants import EPSILON, TINY
from srt3d_ros.kernels.maps import DEPTH, INTENSITY
from srt3d_ros.kernels.torch.arithmetic import waves
from srt3d_ros.kernels.torch.fusing import fused
from srt3d_ros.kernels.torch.method.finalise import local_mean
from srt3d_ros.kernels.torch.method.windows import inner


@fused
def collect(depth, intensity, std, rays, metres_per_bin, metres, num_bins):
    """The list of points that `unpack` reads, by pixel, the strongest first."""
    rows, surfaces, cols = intensity.shape
    there = intensity > 0
    k, row, col = (torch.arange(size, device=intensity.device) for size in (surfaces, rows, cols))
    rank = torch.zeros_like(there, dtype=torch.int64)       # how many of the pixel's points are stronger
    for q in range(surfaces):
        other = intensity[:, q:q + 1]
        rank += (other > intensity) | ((other == intensity) & (k[:, None] > q))
    number = there.sum(dim=1)
    end = number.flatten().cumsum(0)
    place = ((end.view(rows, cols) - number)[:, None] + rank).masked_fill(~there, intensity.numel()).flatten()

    depth = depth.masked_fill(depth >= num_bins, 0)         # rounded up to T
    xyz = rays[:, None] * (depth * metres_per_bin + metres)[..., None]
    where = (values.expand_as(depth).to(depth.dtype) for values in (row[:, None, None], col, rank))
    values = torch.stack([depth, intensity, std, *where]).flatten(1)
    listed, listed_xyz = (each.new_zeros(shape) for each, shape in (
        (values, (len(values), len(place) + 1)), (xyz, (len(place) + 1, 3))))
    return listed.index_copy(1, place, values), listed_xyz.index_copy(0, place, xyz.flatten(0, 2)), end[-1:]


@fused
def unexplained(frame, points, rest, taken, passed):
    """Sums over the pixels of what the points do not explain; y_l = g Σ_k r_k exp(i ω_l t_k), w = b̄ / n̄.

    `own` are the photons of `rest` in used pixels; `taken` is `own` if None.

    Returns:
        float32 [4m + 4], sums over the pixels: of w conj(q_l) (z_l − |ĥ_l|² y_l), real parts before imaginary ones;
        of w y_l in the same way; of w · own, w · taken, w² n and Σ_l |z_l − |ĥ_l|² y_l|² / |ĥ_l|² n̄; b̄ and n̄ are
        `local_mean` of own and of n.
    """
    counts, light, matched, depth, intensity = (inner(frame, values) for values in (
        frame.counts, frame.exposure, frame.matched, points[:, :, DEPTH], points[:, :, INTENSITY]))
    used = (light > 0).to(light.dtype)
    own, energy = rest * used, frame.energy[:, None]
    gives = (intensity * light[:, None])[:, :, None]
    shown = [(gives * wave).sum(dim=1) for wave in waves(frame, depth)]                        # [rows, m, cols] each
    re, im = (z - energy * part for z, part in zip(matched.chunk(2, dim=1), shown))
    around = local_mean(counts, used).clamp(min=EPSILON)
    share = local_mean(own, used) / around
    misfit = ((re**2 + im**2) / energy.clamp(min=TINY) / around[:, None]).sum()
    q_re, q_im = passed.movedim(2, 1).unbind(-1)
    maps = q_re * re + q_im * im, q_re * im - q_im * re, *shown
    sums = [(share * own).sum(), (share * (own if taken is None else taken)).sum(), (share**2 * counts).sum(), misfit]
    return torch.cat([*((share[:, None] * values).sum(dim=(0, 2)) for values in maps), torch.stack(sums)])
