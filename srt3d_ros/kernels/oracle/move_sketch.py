"""Photons that have come to lie elsewhere: `move_sketch`."""

import numpy as np

from srt3d_ros.kernels.lens import LOOKS, distorted


def move_sketch(sums, photons, used, rays, ranges, rotation, offset, lens, bin_frequencies, late, metres_per_bin,
                steepest, moved, numbers):
    """Add the photons of one instant, moved to where they would be seen from at another: to moved and numbers.

    The photons of a pixel with ray d come from range ρ. At the other instant what they show lies at X = ρ R d + p.
    The four pixels i around the place at which X is seen share the photons by bilinear weights w_i; those that lie
    on another surface than the nearest of them, by more than `steepest` of its range, or outside of the array,
    leave their share to it. Between the four lies X, at ρ' = 1 / Σ (w_i / ρ'_i), exactly on a plane that a pinhole
    sees, and ρ = |ρ' X / |X| − p|:

        moved_i += w_i exp(−i ω_l (ρ / metres_per_bin + late)) sums,    numbers_i += w_i n.

    Whoever adds the pixel's own range again has the photons lie on the surface that they were on, at each pixel's own
    place on it. ρ is not known before the place is: the first is that of the pixel, and LOOKS times
    that of the point at the pixel found. Photons that no pixel would see are left out.

    Args:
        sums: as of `prepare`.
        photons: float32 [rows, cols], also parts of photons.
        used: bool [rows, cols], False in masked pixels, whose photons are left out.
        rays: float32 [rows, cols, 3], unit vectors.
        ranges: float32 [rows, cols], ρ' along each ray, m, of every pixel.
        rotation: float32 [3, 3], R.
        offset: float32 [3], p, m.
        lens: as in `kernels.lens`.
        late: float32 [rows, cols], delays, bins.
        moved: complex64 [rows, cols, m]; changed in place, as are
        numbers: float32 [rows, cols].
    """
    rows, cols = photons.shape
    size, rays, ranges = rows * cols, rays.reshape(-1, 3).astype(float), ranges.reshape(-1).astype(float)
    turned, offset = rays @ rotation.T.astype(float), offset.astype(float)
    length = ranges
    for _ in range(LOOKS):
        row, col = _place(turned * length[:, None] + offset, lens.astype(float))
        seen, nearest = _pixel(row, col, rows, cols)
        length = np.where(seen, np.linalg.norm(rays[nearest] * ranges[nearest, None] - offset, axis=1), length)
    xyz = turned * length[:, None] + offset
    row, col = _place(xyz, lens.astype(float))
    seen, nearest = _pixel(row, col, rows, cols)
    chosen = np.flatnonzero(seen & used.reshape(-1) & (photons.reshape(-1) > 0))
    row, col, xyz, nearest = (values[chosen] for values in (row, col, xyz, nearest))
    target, weight = _shares(row, col, nearest, ranges, steepest, rows, cols)
    there = 1 / (weight / ranges[target]).sum(axis=0)
    before = np.linalg.norm(xyz * (there / np.linalg.norm(xyz, axis=1))[:, None] - offset, axis=1)
    depth = before / metres_per_bin + late.reshape(-1)[chosen]
    z = sums.reshape(size, -1)[chosen] * np.exp(-2j * np.pi * depth[:, None] * bin_frequencies)
    for pixel, share in zip(target, weight):
        np.add.at(moved.reshape(size, -1), pixel, share[:, None] * z)
        np.add.at(numbers.reshape(-1), pixel, share * photons.reshape(-1)[chosen])


def _place(xyz, lens):
    """Row and column of each point; NaN where there is none."""
    x, y, z = xyz.T
    with np.errstate(all="ignore"):
        if len(lens) > 4:
            x, y = x / z, y / z
            seen = (z > 0) & (x * x + y * y < lens[9])
            x, y = distorted(x, y, *lens[4:9])
            return np.where(seen, lens[1] * y + lens[3], np.nan), lens[0] * x + lens[2]
        row = (np.arctan2(z, np.hypot(x, y)) - lens[2]) / lens[3]
        return row, ((np.arctan2(y, x) - lens[0]) / lens[1] + 0.5) % (2 * np.pi / abs(lens[1])) - 0.5


def _pixel(row, col, rows, cols):
    """Whether a pixel sees a place, and which is nearest; 0 if none."""
    row, col = np.floor(row + 0.5), np.floor(col + 0.5)
    seen = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
    return seen, np.where(seen, row * cols + col, 0).astype(np.int64)


def _shares(row, col, nearest, ranges, steepest, rows, cols):
    """The four pixels around each place, and the share of each, [4, N]: the nearest has that of other surfaces'."""
    target, weight = [], []
    above, left = np.floor(row).astype(np.int64), np.floor(col).astype(np.int64)
    for down in (0, 1):
        for right in (0, 1):
            r, c = above + down, left + right
            inside = (r >= 0) & (r < rows) & (c >= 0) & (c < cols)
            pixel = np.where(inside, r * cols + c, nearest)
            same = np.abs(ranges[pixel] - ranges[nearest]) <= steepest * ranges[nearest]
            target.append(np.where(same, pixel, nearest))
            weight.append((row - above if down else 1 - row + above) * (col - left if right else 1 - col + left))
    return np.array(target), np.array(weight)
