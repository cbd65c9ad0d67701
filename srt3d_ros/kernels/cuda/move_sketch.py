"""Photons that have come to lie elsewhere: once a part of a frame, by torch."""

import math

import torch

from srt3d_ros.kernels.lens import LOOKS, distorted


def move_sketch(sums, photons, used, rays, ranges, motions, group, lens, bin_frequencies, late, metres_per_bin,
                steepest, moved, numbers):
    rows, cols = photons.shape
    size, rays, ranges = rows * cols, rays.reshape(-1, 3), ranges.reshape(-1)
    motion = motions[group.reshape(-1).long()]
    turned, offset = (motion[:, :, :3] @ rays[..., None])[..., 0], motion[:, :, 3]
    length = ranges
    for _ in range(LOOKS):
        row, col = _place(turned * length[:, None] + offset, lens)
        seen, nearest = _pixel(row, col, rows, cols)
        length = torch.where(seen, (rays[nearest] * ranges[nearest, None] - offset).norm(dim=1), length)
    xyz = turned * length[:, None] + offset
    row, col = _place(xyz, lens)
    seen, nearest = _pixel(row, col, rows, cols)
    numbers_here = photons.reshape(-1) * (seen & (used.reshape(-1) > 0))
    target, weight = _shares(row, col, nearest, ranges, steepest, rows, cols)
    there = 1 / (weight / ranges[target]).sum(dim=0)
    before = (xyz * (there / xyz.norm(dim=1))[:, None] - offset).norm(dim=1)
    z = sums.reshape(size, -1) * _phases(-(before / metres_per_bin + late.reshape(-1)), bin_frequencies)
    weight = torch.where(numbers_here > 0, weight, 0)
    z = torch.where((numbers_here > 0)[:, None], z, 0)      # NaN elsewhere
    for pixel, share in zip(target, weight):
        moved.view(size, -1).index_add_(0, pixel, share[:, None] * z)
        numbers.view(-1).index_add_(0, pixel, share * numbers_here)


def read_moved(moved, ranges, late, bin_frequencies, metres_per_bin):
    return moved * _phases(ranges / metres_per_bin + late, bin_frequencies)


def _phases(depth, bin_frequencies):
    """exp(i ω_l t) of depths t."""
    turns = depth[..., None] * bin_frequencies
    angle = 2 * math.pi * (turns - turns.round())
    return torch.complex(torch.cos(angle), torch.sin(angle))


def _place(xyz, lens):
    """Row and column of each point; NaN where there is none."""
    x, y, z = xyz.unbind(1)
    if len(lens) > 4:
        x, y = x / z, y / z
        seen = (z > 0) & (x * x + y * y < lens[9])
        x, y = distorted(x, y, *lens[4:9])
        return torch.where(seen, lens[1] * y + lens[3], math.nan), lens[0] * x + lens[2]
    row = (torch.atan2(z, torch.hypot(x, y)) - lens[2]) / lens[3]
    return row, ((torch.atan2(y, x) - lens[0]) / lens[1] + 0.5) % (2 * math.pi / lens[1].abs()) - 0.5


def _pixel(row, col, rows, cols):
    """Whether a pixel sees a place, and which is nearest; 0 if none."""
    row, col = (row + 0.5).floor(), (col + 0.5).floor()
    seen = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
    return seen, torch.where(seen, row * cols + col, 0).long()


def _shares(row, col, nearest, ranges, steepest, rows, cols):
    """The four pixels around each place, and the share of each, [4, N]: the nearest has that of other surfaces'."""
    target, weight = [], []
    above, left = row.floor(), col.floor()
    for down in (0, 1):
        for right in (0, 1):
            r, c = above + down, left + right
            inside = (r >= 0) & (r < rows) & (c >= 0) & (c < cols)
            pixel = torch.where(inside, (r * cols + c).nan_to_num(0), nearest).long()
            same = (ranges[pixel] - ranges[nearest]).abs() <= steepest * ranges[nearest]
            target.append(torch.where(same, pixel, nearest))
            weight.append((row - above if down else 1 - row + above) * (col - left if right else 1 - col + left))
    return torch.stack(target), torch.stack(weight)
