"""Photons that have come to lie elsewhere: `move_sketch`.

First each pixel finds where its photons go. Then each band of rows collects its own, in the order of the pixels that
they come from, so that sums do not depend on the number of threads.
"""

import numpy as np
from numba import boolean, float32, int32, int64, prange, types

from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, ONE, ZERO, sincos
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel
from srt3d_ros.kernels.lens import distorted

BAND = 16               # rows: photons on the border between two are turned twice
LOOKS = 2               # times that a pixel looks up its range where it has come to lie; first as from infinity
LANES = 8               # of a vector of float32, at least: a rest would take as long as another vector, or longer
TURN = F32(2 * np.pi)
NOWHERE = F32(-1e9)
_distorted = inline(distorted)
LENSES = types.UniTuple(float32, 4), types.UniTuple(float32, 10)      # spherical; pinhole


@inline
def _place(x, y, z, lens):
    """Row and column at which a point is seen; NOWHERE where there is none."""
    if len(lens) > 4:
        fx, fy, cx, cy, k1, k2, p1, p2, k3, reach = lens
        inverse = ONE / z
        u, v = x * inverse, y * inverse
        seen = (z > ZERO) & (u * u + v * v < reach)
        u, v = _distorted(u, v, k1, k2, p1, p2, k3)
        return (fy * v + cy if seen else NOWHERE), (fx * u + cx if seen else NOWHERE)
    row = (np.arctan2(z, np.sqrt(x * x + y * y)) - lens[2]) / lens[3]
    turn, col = TURN / abs(lens[1]), (np.arctan2(y, x) - lens[0]) / lens[1] + HALF
    return row, col - turn * np.floor(col / turn) - HALF


@line
def _look(turned, offset, length, lens, rows, row, col, nearest):
    """Where the points at `length` along turned rays are seen, and the nearest pixels; −1 where there is none."""
    x, y, z, cols = turned[0], turned[1], turned[2], len(length)
    p, q, r = offset[0], offset[1], offset[2]
    for j in range(cols):
        row[j], col[j] = _place(x[j] * length[j] + p, y[j] * length[j] + q, z[j] * length[j] + r, lens)
        seen = (row[j] >= -HALF) & (row[j] < F32(rows) - HALF) & (col[j] >= -HALF) & (col[j] < F32(cols) - HALF)
        nearest[j] = np.int32(row[j] + HALF) * cols + np.int32(col[j] + HALF) if seen else -1


@line
def _measure(nearest, offset, rays, ranges, length):
    """How far the points at the nearest pixels were from where the photons were seen, m."""
    p, q, r = offset[0], offset[1], offset[2]
    for j in range(len(nearest)):
        at = nearest[j]
        if at >= 0:
            own = ranges[at]
            length[j] = _length(rays[at, 0] * own - p, rays[at, 1] * own - q, rays[at, 2] * own - r)


@inline
def _length(x, y, z):
    return np.sqrt(x * x + y * y + z * z)


@inline
def _share(row, col, nearest, rows, cols, ranges, steepest, at, target, weight):
    """The four pixels around a place, and the share of each; the range between them, m."""
    above, left = np.int64(np.floor(row)), np.int64(np.floor(col))
    down, right, total = row - F32(above), col - F32(left), ZERO
    for k in range(4):
        to_row, to_col = above + (k >> 1), left + (k & 1)
        share = (down if k >> 1 else ONE - down) * (right if k & 1 else ONE - right)
        pixel = to_row * cols + to_col
        inside = (to_row >= 0) & (to_row < rows) & (to_col >= 0) & (to_col < cols)
        if not inside or abs(ranges[pixel] - ranges[nearest]) > steepest * ranges[nearest]:
            pixel = nearest
        target[at, k], weight[at, k] = pixel, share
        total += share / ranges[pixel]
    return ONE / total


@parallel
def _find_targets(rows: int64, cols: int64, photons: float32[::1], used: boolean[::1], rays: float32[:, ::1],
                  ranges: float32[::1], rotation: float32[:, ::1], offset: float32[::1], lens: LENSES,
                  late: float32[::1], metres_per_bin: float32, steepest: float32, target: int32[:, ::1],
                  weight: float32[:, ::1], depth: float32[::1], reached: int64[:, ::1]):
    """Where the photons of each pixel go, and at which depth they were seen, bins; the pixels that each row reaches."""
    p, q, r = offset[0], offset[1], offset[2]
    for i in prange(rows):
        own = rays[i * cols:(i + 1) * cols]
        turned, length = np.empty((3, cols), np.float32), ranges[i * cols:(i + 1) * cols].copy()
        for axis in range(3):
            for j in range(cols):
                turned[axis, j] = (rotation[axis, 0] * own[j, 0] + rotation[axis, 1] * own[j, 1]
                                   + rotation[axis, 2] * own[j, 2])
        row, col, nearest = np.empty(cols, np.float32), np.empty(cols, np.float32), np.empty(cols, np.int32)
        _look(turned, offset, length, lens, rows, row, col, nearest)
        for _ in range(LOOKS):
            _measure(nearest, offset, rays, ranges, length)
            _look(turned, offset, length, lens, rows, row, col, nearest)
        first, last = rows * cols, -1
        for j in range(cols):
            at, to = i * cols + j, np.int64(nearest[j])
            target[at, 0] = -1
            if to >= 0 and photons[at] > ZERO and used[at]:
                there = _share(row[j], col[j], to, rows, cols, ranges, steepest, at, target, weight)
                x, y, z = turned[0, j] * length[j] + p, turned[1, j] * length[j] + q, turned[2, j] * length[j] + r
                scale = there / _length(x, y, z)
                depth[at] = _length(x * scale - p, y * scale - q, z * scale - r) / metres_per_bin + late[at]
                first, last = min(first, to), max(last, to)
        reached[i, 0], reached[i, 1] = first - cols - 1, last + cols + 1


@parallel
def _collect(rows: int64, cols: int64, sums: float32[:, ::1], photons: float32[::1], target: int32[:, ::1],
             weight: float32[:, ::1], depth: float32[::1], reached: int64[:, ::1], bin_frequencies: float32[::1],
             moved: float32[:, ::1], numbers: float32[::1]):
    twice = sums.shape[1]
    for band in prange((rows + BAND - 1) // BAND):
        begin, end = band * BAND * cols, min((band + 1) * BAND * cols, rows * cols)
        z = np.empty(twice, np.float32)
        cosine, sine = np.empty_like(bin_frequencies), np.empty_like(bin_frequencies)
        for i in range(rows):
            if reached[i, 1] < begin or reached[i, 0] >= end:
                continue
            for at in range(i * cols, (i + 1) * cols):
                a, b, c, d = target[at, 0], target[at, 1], target[at, 2], target[at, 3]
                if a < 0 or max(max(a, b), max(c, d)) < begin or min(min(a, b), min(c, d)) >= end:
                    continue
                for l in range(len(bin_frequencies)):
                    sine[l], cosine[l] = sincos(bin_frequencies[l] * depth[at])
                for l in range(twice // 2):
                    re, im = sums[at, 2 * l], sums[at, 2 * l + 1]
                    z[2 * l] = re * cosine[l] + im * sine[l]
                    z[2 * l + 1] = im * cosine[l] - re * sine[l]
                for k in range(4):
                    pixel, share = target[at, k], weight[at, k]
                    if pixel >= begin and pixel < end and share > ZERO:
                        numbers[pixel] += share * photons[at]
                        for l in range(twice):
                            moved[pixel, l] += share * z[l]


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
    rows, cols, m = sums.shape
    size, photons, whole = rows * cols, photons.reshape(-1), -(-m // LANES) * LANES
    target, weight = np.empty((size, 4), np.int32), np.empty((size, 4), np.float32)
    depth, reached = np.empty(size, np.float32), np.empty((rows, 2), np.int64)
    _find_targets(rows, cols, photons, used.reshape(-1), rays.reshape(size, 3), ranges.reshape(-1), rotation, offset,
                  tuple(lens), late.reshape(-1), F32(metres_per_bin), F32(steepest), target, weight, depth, reached)
    padded = np.zeros(whole, np.float32)
    padded[:m] = bin_frequencies
    _collect(rows, cols, np.ascontiguousarray(sums).view(np.float32).reshape(size, 2 * m), photons, target, weight,
             depth, reached, padded, moved.view(np.float32).reshape(size, 2 * m), numbers.reshape(-1))
