"""Photons that have come to lie elsewhere: `move_sketch` and `read_moved`.

Where each pixel's photons go is found row by row. Then each band of rows collects its own, in the order of the pixels
that they come from, so that sums do not depend on the number of threads.
"""

import numpy as np
from numba import prange

from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, ONE, ZERO, sincos
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel
from srt3d_ros.kernels.lens import LOOKS, distorted

BAND = 16               # rows: photons on the border between two are turned twice
LANES = 8               # of a vector of float32, at least
TURN = F32(2 * np.pi)
NOWHERE = F32(-1e9)
_distorted = inline(distorted)


@line
def _turn(i, rays, motions, group, turned, offset):
    """The rays of a row, turned, and the offset of each, [3, cols]."""
    for j in range(rays.shape[1]):
        g, a, b, c = group[i, j], rays[i, j, 0], rays[i, j, 1], rays[i, j, 2]
        for axis in range(3):
            turned[axis, j] = motions[g, axis, 0] * a + motions[g, axis, 1] * b + motions[g, axis, 2] * c
            offset[axis, j] = motions[g, axis, 3]


@line
def _see(turned, offset, length, lens, row, col):
    """Row and column of the points at `length` along the rays of a row; NOWHERE where there is none."""
    x, y, z, p, q, r = turned[0], turned[1], turned[2], offset[0], offset[1], offset[2]
    if len(lens) > 4:
        fx, fy, cx, cy, k1, k2, p1, p2, k3, reach = lens
        for j in range(len(length)):
            w = z[j] * length[j] + r[j]
            inverse = ONE / w
            u, v = (x[j] * length[j] + p[j]) * inverse, (y[j] * length[j] + q[j]) * inverse
            seen = (w > ZERO) & (u * u + v * v < reach)
            u, v = _distorted(u, v, k1, k2, p1, p2, k3)
            row[j] = fy * v + cy if seen else NOWHERE
            col[j] = fx * u + cx if seen else NOWHERE
    else:
        turn = TURN / abs(lens[1])
        for j in range(len(length)):
            u, v, w = x[j] * length[j] + p[j], y[j] * length[j] + q[j], z[j] * length[j] + r[j]
            row[j] = (np.arctan2(w, np.sqrt(u * u + v * v)) - lens[2]) / lens[3]
            at = (np.arctan2(v, u) - lens[0]) / lens[1] + HALF
            col[j] = at - turn * np.floor(at / turn) - HALF


@line
def _find_nearest(row, col, rows, nearest):
    """The pixel nearest to each place of a row; −1 where the array has none."""
    cols = len(nearest)
    for j in range(cols):
        seen = (row[j] >= -HALF) & (row[j] < F32(rows) - HALF) & (col[j] >= -HALF) & (col[j] < F32(cols) - HALF)
        nearest[j] = np.int32(row[j] + HALF) * cols + np.int32(col[j] + HALF) if seen else -1


@line
def _measure(nearest, offset, rays, ranges, length):
    """How far the points at the nearest pixels were from where the photons were seen, m."""
    for j in range(len(nearest)):
        at = nearest[j]
        if at >= 0:
            e = ranges[at]
            u, v, w = rays[at, 0] * e - offset[0, j], rays[at, 1] * e - offset[1, j], rays[at, 2] * e - offset[2, j]
            length[j] = np.sqrt(u * u + v * v + w * w)


@line
def _share(row, col, nearest, ranges, steepest, rows, target, weight, there):
    """The four pixels around each place, and the share of each; the range between them, m."""
    cols = len(nearest)
    for j in range(cols):
        at = nearest[j]
        if at < 0:
            continue
        above, left = np.int64(np.floor(row[j])), np.int64(np.floor(col[j]))
        down, right, own, total = row[j] - F32(above), col[j] - F32(left), ranges[at], ZERO
        limit = steepest * own
        for k in range(4):
            to_row, to_col = above + (k >> 1), left + (k & 1)
            share = (down if k >> 1 else ONE - down) * (right if k & 1 else ONE - right)
            pixel = to_row * cols + to_col
            inside = (to_row >= 0) & (to_row < rows) & (to_col >= 0) & (to_col < cols)
            if not inside or abs(ranges[pixel] - own) > limit:
                pixel = np.int64(at)
            target[j, k], weight[j, k] = pixel, share
            total += share / ranges[pixel]
        there[j] = ONE / total


@line
def _depths(turned, offset, length, there, late, metres_per_bin, depth):
    """The depth, bins, at which what is now at range `there` was seen."""
    for j in range(len(length)):
        p, q, r, e = offset[0, j], offset[1, j], offset[2, j], length[j]
        x, y, z = turned[0, j] * e + p, turned[1, j] * e + q, turned[2, j] * e + r
        scale = there[j] / np.sqrt(x * x + y * y + z * z)
        x, y, z = x * scale - p, y * scale - q, z * scale - r
        depth[j] = np.sqrt(x * x + y * y + z * z) / metres_per_bin + late[j]


@parallel
def _targets(photons, used, rays, ranges, motions, group, lens, late, metres_per_bin, steepest, target, weight, depth,
             reached):
    rows, cols = photons.shape
    all_rays, all_ranges = rays.reshape(rows * cols, 3), ranges.reshape(rows * cols)
    for i in prange(rows):
        turned, offset = np.empty((3, cols), np.float32), np.empty((3, cols), np.float32)
        row, col, there = np.empty(cols, np.float32), np.empty(cols, np.float32), np.ones(cols, np.float32)
        length, nearest = ranges[i].copy(), np.empty(cols, np.int32)
        _turn(i, rays, motions, group, turned, offset)
        for _ in range(LOOKS):
            _see(turned, offset, length, lens, row, col)
            _find_nearest(row, col, rows, nearest)
            _measure(nearest, offset, all_rays, all_ranges, length)
        _see(turned, offset, length, lens, row, col)
        _find_nearest(row, col, rows, nearest)
        for j in range(cols):
            if photons[i, j] == ZERO or used[i, j] == ZERO:
                nearest[j] = -1
        _share(row, col, nearest, all_ranges, steepest, rows, target[i], weight[i], there)
        _depths(turned, offset, length, there, late[i], metres_per_bin, depth[i])
        first, last = rows * cols, -1
        for j in range(cols):
            if nearest[j] < 0:
                target[i, j, 0] = -1
            else:
                first, last = min(first, nearest[j]), max(last, nearest[j])
        reached[i, 0], reached[i, 1] = first - cols - 1, last + cols + 1


@line
def _padded(bin_frequencies):
    """Frequencies in whole vectors: a rest would take as long as another vector, or longer."""
    padded = np.zeros(-(-len(bin_frequencies) // LANES) * LANES, np.float32)
    padded[:len(bin_frequencies)] = bin_frequencies
    return padded


@parallel
def _collect(sums, photons, target, weight, depth, reached, bin_frequencies, moved, numbers):
    rows, cols, twice = sums.shape
    m, size = twice // 2, rows * cols
    for band in prange((rows + BAND - 1) // BAND):
        begin, end = band * BAND * cols, min((band + 1) * BAND * cols, size)
        z, turns = np.empty(twice, np.float32), _padded(bin_frequencies)
        cosine, sine = np.empty_like(turns), np.empty_like(turns)
        for i in range(rows):
            if reached[i, 1] < begin or reached[i, 0] >= end:
                continue
            for j in range(cols):
                if target[i, j, 0] < 0:
                    continue
                a, b, c, d = target[i, j, 0], target[i, j, 1], target[i, j, 2], target[i, j, 3]
                if max(max(a, b), max(c, d)) < begin or min(min(a, b), min(c, d)) >= end:
                    continue
                at = depth[i, j]
                for l in range(len(turns)):
                    sine[l], cosine[l] = sincos(turns[l] * at)
                for l in range(m):
                    re, im = sums[i, j, 2 * l], sums[i, j, 2 * l + 1]
                    z[2 * l] = re * cosine[l] + im * sine[l]
                    z[2 * l + 1] = im * cosine[l] - re * sine[l]
                for k in range(4):
                    pixel, share = target[i, j, k], weight[i, j, k]
                    if pixel >= begin and pixel < end and share > ZERO:
                        numbers[pixel] += share * photons[i, j]
                        for l in range(twice):
                            moved[pixel, l] += share * z[l]


def move_sketch(sums, photons, used, rays, ranges, motions, group, lens, bin_frequencies, late, metres_per_bin,
                steepest, moved, numbers):
    rows, cols, m = sums.shape
    target, weight = np.empty((rows, cols, 4), np.int32), np.empty((rows, cols, 4), np.float32)
    depth, reached = np.empty((rows, cols), np.float32), np.empty((rows, 2), np.int64)
    _targets(photons, used, rays, ranges, motions, group, lens, late, F32(metres_per_bin), F32(steepest), target,
             weight, depth, reached)
    _collect(np.ascontiguousarray(sums).view(np.float32), photons, target, weight, depth, reached, bin_frequencies,
             moved.view(np.float32).reshape(rows * cols, 2 * m), numbers.reshape(-1))


@parallel
def _read_moved(moved, ranges, late, bin_frequencies, metres_per_bin, sums):
    rows, cols, twice = moved.shape
    for i in prange(rows):
        turns = _padded(bin_frequencies)
        cosine, sine = np.empty_like(turns), np.empty_like(turns)
        for j in range(cols):
            at = ranges[i, j] / metres_per_bin + late[i, j]
            for l in range(len(turns)):
                sine[l], cosine[l] = sincos(turns[l] * at)
            for l in range(twice // 2):
                re, im = moved[i, j, 2 * l], moved[i, j, 2 * l + 1]
                sums[i, j, 2 * l] = re * cosine[l] - im * sine[l]
                sums[i, j, 2 * l + 1] = im * cosine[l] + re * sine[l]


def read_moved(moved, ranges, late, bin_frequencies, metres_per_bin):
    sums = np.empty_like(moved)
    _read_moved(moved.view(np.float32), ranges, late, bin_frequencies, F32(metres_per_bin), sums.view(np.float32))
    return sums
