"""The list of the points of a frame: `collect`."""

import torch

from srt3d_ros.kernels.torch.fusing import fused


@fused
def collect(depth, intensity, std, rays, metres_per_bin, metres, num_bins):
    """The list of points that `unpack` reads, by pixel, the strongest first.

    Only the device knows how many there are, so the list has room for K in every pixel.
    """
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
