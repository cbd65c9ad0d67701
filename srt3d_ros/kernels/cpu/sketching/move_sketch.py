"""Move sketches to where their photons would be seen from, after the sensor has moved: `move_sketches`.

The photons of a pixel with ray d come from range ρ, so what they show lies at X = ρ R d + p after the motion. The four
pixels i around the place at which X is then seen share the photons by bilinear weights w_i, each as if its part of the
surface, at its own range ρ'_i, had been seen:

    moved_i += w_i exp(i ω_l ((ρ'_i − ρ) / metres_per_bin + late_i − late)) sums,    numbers_i += w_i n.

ρ' = 1 / Σ_i (w_i / ρ'_i) is the range of the surface between the four, exact for a plane seen by a pinhole, and
ρ = |ρ' X / |X| − p|. The place depends on ρ and ρ on the place, so they are found in turns: ρ is first that of the
pixel itself, then LOOKS times that of the surface at the pixel found.

Three passes: each pixel finds where its photons go; each band of rows collects its own, in the order of the pixels that
they come from; each pixel turns by its ρ'_i. So sums do not depend on the number of threads.
"""

from typing import NamedTuple

import numpy as np
from numba import boolean, float32, int32, int64, njit, prange, types

from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, ONE, ZERO, sincos
from srt3d_ros.kernels.cpu.compiling import floats1d, floats2d, inline, line, parallel
from srt3d_ros.kernels.lens import distorted

BAND = 16               # rows collected by one thread; photons on the border of two bands are turned twice
LOOKS = 2               # how often a pixel looks up ρ at the place found
WIDTH = 8               # frequencies are padded to a multiple: the rest of a vector takes as long as a whole one
TURN = F32(2 * np.pi)
NOWHERE = F32(-1e9)
_distorted = inline(distorted)


class SeenScene(NamedTuple):
    """A sensor's pixels and the surfaces that they see after the motion; [rows, cols] is one axis in compiled code."""

    used: boolean[::1]              # [rows, cols]; photons of other pixels are left out
    rays: floats2d           # [rows, cols, 3], unit vectors
    ranges: floats1d            # [rows, cols], ρ' along each ray, m
    late: floats1d              # [rows, cols], delays, bins
    bin_frequencies: floats1d   # [m], k_l / T
    metres_per_bin: float32
    steepest: float32               # share of ρ' by which the four pixels may differ from the nearest of them


class Motion(NamedTuple):
    """The sensor's motion, from X before to R X + p after."""

    rotation: floats2d       # R, [3, 3]
    offset: floats1d            # p, [3], m


class Targets(NamedTuple):
    """Where the photons of each pixel go."""

    pixels: int32[:, ::1]       # [pixels, 4]; first −1: nowhere
    weights: floats2d    # [pixels, 4], w_i
    depth: floats1d         # [pixels], ρ / metres_per_bin + late, bins
    reached: int64[:, ::1]      # [rows, 2], the first and the last pixel that a row's photons may reach


LENSES = types.UniTuple(float32, 4), types.UniTuple(float32, 10)      # of `kernels.lens`: spherical; pinhole


@inline
def place(x, y, z, lens):
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
def _look(turned, length, offset, lens, rows, seen):
    """Write where the points at `length` along turned rays are seen, and the nearest pixels; −1 where there is none."""
    x, y, z, cols = turned[0], turned[1], turned[2], len(length)
    (row, col, nearest), p, q, r = seen, offset[0], offset[1], offset[2]
    for j in range(cols):
        row[j], col[j] = place(x[j] * length[j] + p, y[j] * length[j] + q, z[j] * length[j] + r, lens)
        inside = (row[j] >= -HALF) & (row[j] < F32(rows) - HALF) & (col[j] >= -HALF) & (col[j] < F32(cols) - HALF)
        nearest[j] = np.int32(row[j] + HALF) * cols + np.int32(col[j] + HALF) if inside else -1


@line
def _measure(nearest, offset, rays, ranges, length):
    """Write how far the surfaces at the nearest pixels were from where the photons were seen, m."""
    p, q, r = offset[0], offset[1], offset[2]
    for j in range(len(nearest)):
        pixel = nearest[j]
        if pixel >= 0:
            own = ranges[pixel]
            length[j] = norm(rays[pixel, 0] * own - p, rays[pixel, 1] * own - q, rays[pixel, 2] * own - r)


@inline
def norm(x, y, z):
    return np.sqrt(x * x + y * y + z * z)


@inline
def _share(row, col, nearest, shape, scene, pixels, weights):
    """Write the four pixels around a place and the weight of each; returns the range between them, ρ', m."""
    (rows, cols), ranges = shape, scene.ranges
    above, left = np.int64(np.floor(row)), np.int64(np.floor(col))
    down, right, total = row - F32(above), col - F32(left), ZERO
    for k in range(4):
        to_row, to_col = above + (k >> 1), left + (k & 1)
        weight = (down if k >> 1 else ONE - down) * (right if k & 1 else ONE - right)
        pixel = to_row * cols + to_col
        inside = (to_row >= 0) & (to_row < rows) & (to_col >= 0) & (to_col < cols)
        if not inside or abs(ranges[pixel] - ranges[nearest]) > scene.steepest * ranges[nearest]:
            pixel = nearest
        pixels[k], weights[k] = pixel, weight
        total += weight / ranges[pixel]
    return ONE / total


@njit(error_model="numpy")
def _find_row(i, photons, scene, lens, motion, targets):
    """Write the targets of one row of pixels."""
    (rows, cols), rotation, offset = photons.shape, motion.rotation, motion.offset
    p, q, r = offset[0], offset[1], offset[2]
    own = scene.rays[i * cols:(i + 1) * cols]
    turned, length = np.empty((3, cols), np.float32), scene.ranges[i * cols:(i + 1) * cols].copy()
    for axis in range(3):
        for j in range(cols):
            turned[axis, j] = (rotation[axis, 0] * own[j, 0] + rotation[axis, 1] * own[j, 1]
                               + rotation[axis, 2] * own[j, 2])
    row, col, nearest = np.empty(cols, np.float32), np.empty(cols, np.float32), np.empty(cols, np.int32)
    _look(turned, length, offset, lens, rows, (row, col, nearest))
    for _ in range(LOOKS):
        _measure(nearest, offset, scene.rays, scene.ranges, length)
        _look(turned, length, offset, lens, rows, (row, col, nearest))
    first, last = rows * cols, -1
    for j in range(cols):
        at, to = i * cols + j, np.int64(nearest[j])
        pixels, weights = targets.pixels[at], targets.weights[at]
        pixels[0] = -1
        if to >= 0 and photons[i, j] > ZERO and scene.used[at]:
            there = _share(row[j], col[j], to, photons.shape, scene, pixels, weights)
            x, y, z = turned[0, j] * length[j] + p, turned[1, j] * length[j] + q, turned[2, j] * length[j] + r
            scale = there / norm(x, y, z)
            distance = norm(x * scale - p, y * scale - q, z * scale - r)
            targets.depth[at] = distance / scene.metres_per_bin + scene.late[at]
            first, last = min(first, to), max(last, to)
    targets.reached[i, 0], targets.reached[i, 1] = first - cols - 1, last + cols + 1


@parallel
def _find_targets(photons: floats2d, scene: SeenScene, lens: LENSES, motion: Motion, targets: Targets):
    for i in prange(len(photons)):      # its body in a function: numba drops what a loop writes to a tuple's arrays
        _find_row(i, photons, scene, lens, motion, targets)


@parallel
def _collect(sums: floats2d, photons: floats2d, scene: SeenScene, targets: Targets,
             moved: floats2d, numbers: floats1d):
    (rows, cols), twice, reached, bin_frequencies = photons.shape, sums.shape[1], targets.reached, scene.bin_frequencies
    for band in prange((rows + BAND - 1) // BAND):
        begin, end = band * BAND * cols, min((band + 1) * BAND * cols, rows * cols)
        z = np.empty(twice, np.float32)
        cosine, sine = np.empty_like(bin_frequencies), np.empty_like(bin_frequencies)
        for i in range(rows):
            if reached[i, 1] < begin or reached[i, 0] >= end:
                continue
            for j in range(cols):
                at = i * cols + j
                pixels, weights = targets.pixels[at], targets.weights[at]
                a, b, c, d = pixels[0], pixels[1], pixels[2], pixels[3]
                if a < 0 or max(max(a, b), max(c, d)) < begin or min(min(a, b), min(c, d)) >= end:
                    continue
                for l in range(len(bin_frequencies)):
                    sine[l], cosine[l] = sincos(bin_frequencies[l] * targets.depth[at])
                for l in range(twice // 2):
                    re, im = sums[at, 2 * l], sums[at, 2 * l + 1]
                    z[2 * l] = re * cosine[l] + im * sine[l]
                    z[2 * l + 1] = im * cosine[l] - re * sine[l]
                for k in range(4):
                    pixel, weight = pixels[k], weights[k]
                    if pixel >= begin and pixel < end and weight > ZERO:
                        numbers[pixel] += weight * photons[i, j]
                        for l in range(twice):
                            moved[pixel, l] += weight * z[l]


@parallel
def _turn(sums: floats2d, depth: floats2d, bin_frequencies: floats1d):
    rows, cols = depth.shape
    for i in prange(rows):
        cosine, sine = np.empty_like(bin_frequencies), np.empty_like(bin_frequencies)
        for j in range(cols):
            for l in range(len(bin_frequencies)):
                sine[l], cosine[l] = sincos(bin_frequencies[l] * depth[i, j])
            for l in range(sums.shape[1] // 2):
                re, im = sums[i * cols + j, 2 * l], sums[i * cols + j, 2 * l + 1]
                sums[i * cols + j, 2 * l] = re * cosine[l] - im * sine[l]
                sums[i * cols + j, 2 * l + 1] = im * cosine[l] + re * sine[l]


def move_sketches(parts, scene, lens):
    """Sums and photons of several instants, where they would be seen from after the motion of each, added up.

    Photons that no pixel would see are left out. A pixel outside of the array, or on another surface
    (`SeenScene.steepest`), leaves its share to the nearest of the four.

    Args:
        parts: of each instant its `Motion`; complex64 [rows, cols, m], Σ_p exp(i ω_l x_p); and float32 [rows, cols],
            n, also parts of photons.
        scene: `SeenScene`.
        lens: of `kernels.lens`.

    Returns:
        complex64 [rows, cols, m], float32 [rows, cols].
    """
    (rows, cols), m = scene.ranges.shape, len(scene.bin_frequencies)
    size, bin_frequencies = rows * cols, np.zeros(-(-m // WIDTH) * WIDTH, np.float32)       # whole vectors
    bin_frequencies[:m] = scene.bin_frequencies
    flat = (values.reshape(size, *values.shape[2:]) for values in scene[:4])
    flat = SeenScene(*flat, bin_frequencies, F32(scene.metres_per_bin), F32(scene.steepest))
    targets = Targets(np.empty((size, 4), np.int32), np.empty((size, 4), np.float32), np.empty(size, np.float32),
                      np.empty((rows, 2), np.int64))
    moved, numbers = np.zeros((size, 2 * m), np.float32), np.zeros(size, np.float32)
    for motion, sums, photons in parts:
        _find_targets(photons, flat, tuple(lens), motion, targets)
        sums = np.ascontiguousarray(sums).view(np.float32).reshape(size, 2 * m)
        _collect(sums, photons, flat, targets, moved, numbers)
    _turn(moved, scene.ranges / flat.metres_per_bin + scene.late, bin_frequencies)
    return moved.view(np.complex64).reshape(rows, cols, m), numbers.reshape(rows, cols)
