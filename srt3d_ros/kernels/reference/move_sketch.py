"""Photons that have come to lie elsewhere: `move_sketch` of `kernels.api`."""

import numpy as np

from srt3d_ros.kernels.lens import LOOKS, distorted


def move_sketch(sums, photons, used, rays, nearness, motions, group, lens, bin_frequencies, late, metres_per_bin,
                moved, numbers):
    rows, cols = photons.shape
    motion = motions.astype(float)[group.reshape(-1)]
    forward = np.einsum("pij,pj->pi", motion[:, :, :3], rays.reshape(-1, 3).astype(float))
    offset, near = motion[:, :, 3], np.zeros(rows * cols)
    for look in range(LOOKS + 1):
        xyz = forward + near[:, None] * offset
        place, inside = _place(xyz, lens.astype(float), rows, cols)
        if look < LOOKS:
            there = nearness.reshape(-1)[place].astype(float)
            apart = np.linalg.norm(rays.reshape(-1, 3)[place] - there[:, None] * offset, axis=1)
            near = np.where(inside & (apart > 0), there / np.maximum(apart, 1e-30), near)
    farther = (2 * (forward * offset).sum(axis=1) + near * (offset**2).sum(axis=1)) / (np.linalg.norm(xyz, axis=1) + 1)
    shift = farther / metres_per_bin + late.reshape(-1)[place] - late.reshape(-1)
    chosen = np.flatnonzero(inside & (used.reshape(-1) > 0) & (photons.reshape(-1) > 0))
    turned = np.exp(2j * np.pi * shift[chosen, None] * bin_frequencies.astype(float))
    turned *= sums.reshape(rows * cols, -1)[chosen]
    np.add.at(moved.reshape(rows * cols, -1), place[chosen], turned)
    np.add.at(numbers.reshape(-1), place[chosen], photons.reshape(-1)[chosen].astype(np.int64))


def _place(xyz, lens, rows, cols):
    """The pixel that sees each point, and whether one does."""
    x, y, z = xyz.T
    with np.errstate(all="ignore"):
        if len(lens) > 4:
            x, y = x / z, y / z
            seen = (z > 0) & (x * x + y * y < lens[9])
            x, y = distorted(x, y, *lens[4:9])
            row, col = lens[1] * y + lens[3], lens[0] * x + lens[2]
        else:
            seen = True
            row = (np.arctan2(z, np.hypot(x, y)) - lens[2]) / lens[3]
            col = ((np.arctan2(y, x) - lens[0]) / lens[1] + 0.5) % (2 * np.pi / abs(lens[1])) - 0.5
        row, col = np.floor(row + 0.5), np.floor(col + 0.5)
        inside = seen & (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
    return np.where(inside, row * cols + col, 0).astype(np.int64), inside
