"""The end of a reconstruction: which points the photons speak for, how bright and how sure each is, and their list."""

import numpy as np
from numba import prange

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import LEAST_SHARE, WINDOWS
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, ONE, TINY, ZERO
from srt3d_ros.kernels.cpu.blur import blur
from srt3d_ros.kernels.cpu.compiling import parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, MARGIN, RESIDUAL, SCORE, SLOPE_COL, SLOPE_ROW, STD, VALUE

SHARE_WEIGHTS = maps.window_weights(WINDOWS[0][0])


@parallel
def _excess(counts, exposure, moments, total, state, terms, own, out):
    rows, twice, cols = out.shape
    surfaces = twice // 2
    for i in prange(rows):
        a = i + MARGIN
        for k in range(surfaces):
            for j in range(cols):
                b = j + MARGIN
                pooled, light = state[a, k, INTENSITY, b], max(exposure[a, b], EPSILON)
                own[i, k, j] = terms[a, k, VALUE, b] / (total * light)
                excess = own[i, k, j] - pooled
                background = max(counts[a, b] - pooled * light, ZERO)
                variance = (pooled * light * moments[0] + background * moments[1]) / (total * light)**2
                out[i, k, j] = excess * excess if pooled > ZERO else ZERO
                out[i, surfaces + k, j] = variance if pooled > ZERO else ZERO


@parallel
def _finalise(photons, exposure, clutter, enough, num_bins, state, own, around, intensity, std, background):
    rows, surfaces, cols = intensity.shape
    for i in prange(rows):
        a = i + MARGIN
        for j in range(cols):
            b = j + MARGIN
            seen = ZERO
            for k in range(surfaces):
                pooled, here = state[a, k, INTENSITY, b], int(np.rint(state[a, k, DEPTH, b])) % len(clutter)
                # Not a quotient of squares: fast mathematics would multiply by one before it divides by the other.
                differ = ONE - min(around[i, surfaces + k, j] / max(around[i, k, j], TINY), ONE)
                value = max(pooled + (own[i, k, j] - pooled) * differ, F32(LEAST_SHARE) * pooled)
                kept = state[a, k, SCORE, b] / clutter[here] > enough and pooled > ZERO
                intensity[i, k, j] = value if kept else ZERO
                seen += intensity[i, k, j] * exposure[a, b]
                noise, bent = state[a, k, STD, b], state[a, k, RESIDUAL, b]
                std[i, k, j] = min(max(np.sqrt(noise * noise + bent * bent), EPSILON), F32(num_bins))
            background[i, j] = max(F32(photons[i, j]) - seen, ZERO)


def finalise(frame, photons, state, terms, enough):
    (rows, cols), surfaces = frame.shape, state.shape[1]
    own = borrow("own", (rows, surfaces, cols))
    excess = borrow("excess", (rows, 2 * surfaces, cols))
    _excess(frame.counts, frame.exposure, frame.intensity_moments, F32(frame.total_energy), state, terms, own, excess)
    around = blur(excess, SHARE_WEIGHTS)
    intensity, std = (borrow(name, (rows, surfaces, cols)) for name in ("intensity", "std"))
    background = np.empty((rows, cols), np.float32)
    clutter = np.full(1, ONE) if frame.clutter is None else frame.clutter
    _finalise(photons, frame.exposure, clutter, F32(enough), frame.num_bins, state, own, around, intensity, std,
            background)
    return intensity, std, background


@parallel
def _collect(state, intensity, std, rays, metres_per_bin, metres, num_bins, first, row, col, rank, values, xyz):
    rows, surfaces, cols = intensity.shape
    for i in prange(rows):
        n = first[i]
        for j in range(cols):
            above, place = F32(np.inf), -1
            for order in range(surfaces):
                best, k = ZERO, -1                              # the strongest that is not in the list yet
                for q in range(surfaces):
                    r = intensity[i, q, j]
                    if r > best and (r < above or (r == above and q > place)):
                        best, k = r, q
                if k < 0:
                    break
                above, place = best, k
                depth = state[i + MARGIN, k, DEPTH, j + MARGIN]
                depth = depth if depth < F32(num_bins) else ZERO
                row[n], col[n], rank[n] = i, j, order
                values[0, n], values[1, n], values[2, n] = depth, best, std[i, k, j]
                values[3, n] = state[i + MARGIN, k, SLOPE_ROW, j + MARGIN]
                values[4, n] = state[i + MARGIN, k, SLOPE_COL, j + MARGIN]
                range_m = np.float64(depth) * metres_per_bin + metres
                for c in range(3):
                    xyz[n, c] = rays[i, j, c] * range_m
                n += 1


def collect(state, intensity, std, rays, metres_per_bin, metres, num_bins):
    counts = np.count_nonzero(intensity, axis=(1, 2))
    ends = np.cumsum(counts)
    points = int(ends[-1])
    row, col = (np.empty(points, np.uint16) for _ in range(2))
    rank = np.empty(points, np.uint8)
    values, xyz = np.empty((5, points), np.float32), np.empty((points, 3), np.float32)
    _collect(state, intensity, std, rays, metres_per_bin, metres, num_bins, ends - counts, row, col, rank, values, xyz)
    return row, col, rank, values, xyz


def unpack(points):
    return points
