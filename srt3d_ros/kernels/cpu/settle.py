"""The end of a reconstruction: which points the photons speak for, how bright and how sure each is, and their list."""

import numpy as np
from numba import prange

from srt3d_ros.core.layout import DEPTH, INTENSITY, MARGIN, SCORE, SLOPE_COL, SLOPE_ROW, STD
from srt3d_ros.core.start import window_weights
from srt3d_ros.kernels.constants import DIMMEST, FAINTEST, LEAST_SHARE, SHARE_WINDOW
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, TINY, ZERO
from srt3d_ros.kernels.cpu.blur import blur
from srt3d_ros.kernels.cpu.compiling import parallel
from srt3d_ros.kernels.cpu.intensity import own_intensity
from srt3d_ros.kernels.cpu.relief import relief
from srt3d_ros.kernels.cpu.scratch import borrow

SHARE_WEIGHTS = window_weights(SHARE_WINDOW, 1)


@parallel
def _excess(noise, exposure, moments, total, state, own, out):
    rows, twice, cols = out.shape
    surfaces = twice // 2
    for i in prange(rows):
        a = i + MARGIN
        for k in range(surfaces):
            for j in range(cols):
                b = j + MARGIN
                pooled, light = state[a, k, INTENSITY, b], max(exposure[a, b], F32(DIMMEST))
                excess = own[a, k, b] - pooled
                background = max(noise[a, b] - pooled * light, ZERO)
                variance = (pooled * light * moments[0] + background * moments[1]) / (total * light)**2
                out[i, k, j] = excess * excess if pooled > ZERO else ZERO
                out[i, surfaces + k, j] = variance if pooled > ZERO else ZERO


@parallel
def _settle(photons, exposure, clutter, enough, num_bins, state, own, around, bent, intensity, std, background):
    rows, surfaces, cols = intensity.shape
    for i in prange(rows):
        a = i + MARGIN
        for j in range(cols):
            b = j + MARGIN
            first, seen = ZERO, ZERO
            for k in range(surfaces):
                pooled, here = state[a, k, INTENSITY, b], int(np.rint(state[a, k, DEPTH, b])) % len(clutter)
                # Not a quotient of squares: fast mathematics would multiply by one before it divides by the other.
                differ = ONE - min(around[i, surfaces + k, j] / max(around[i, k, j], TINY), ONE)
                value = max(pooled + (own[a, k, b] - pooled) * differ, F32(LEAST_SHARE) * pooled)
                kept = state[a, k, SCORE, b] / clutter[here] > enough and pooled > ZERO
                intensity[i, k, j] = value if kept else ZERO
                first = max(first, intensity[i, k, j])
                spread = np.sqrt(state[a, k, STD, b] * state[a, k, STD, b] + bent[a, k, b] * bent[a, k, b])
                std[i, k, j] = min(max(spread, F32(DIMMEST)), F32(num_bins))
            for k in range(surfaces):
                if intensity[i, k, j] < F32(FAINTEST) * first:
                    intensity[i, k, j] = ZERO
                seen += intensity[i, k, j] * exposure[a, b]
            background[i, j] = max(F32(photons[i, j]) - seen, ZERO)


def settle(data, photons, state, enough, window, radius, gate, scratch=None):
    """The points that the photons speak for: how bright and how sure each is; and the background.

    The intensity lies between that of a point's pool and that of its own pixel, which counts as far as pixels truly
    differ. With v the variance of the own intensity by photon noise, and s² the mean square of own − pooled around a
    pixel, the pixels themselves differ by τ² = s² − v, and pooled + (own − pooled) · τ² / (τ² + v) has the least error
    (James and Stein's estimator).

    Args:
        data: the frame, padded.
        photons: uint32 [rows, cols], all that the frame's pixels saw.
        state: float32 [rows', K, FIELDS, cols'].
        enough: score above which a point is kept, standard deviations.
        window, radius, gate: of `relief`, which counts as uncertainty.
        scratch: memory to use.

    Returns:
        intensity (0: no point) and std (bins), float32 [rows, K, cols], and background photons, float32 [rows, cols].
    """
    (rows, cols), surfaces, wide = data.shape, state.shape[1], (state.shape[0], state.shape[1], state.shape[3])
    own = own_intensity(data, state, borrow(scratch, "own", wide))
    bent = relief(state, window, radius, gate, data.num_bins, borrow(scratch, "relief", wide, True))
    excess = borrow(scratch, "excess", (rows, 2 * surfaces, cols))
    _excess(data.noise, data.exposure, data.intensity_moments, F32(data.total_energy), state, own, excess)
    around = blur(excess, SHARE_WEIGHTS, 1)
    intensity, std = (borrow(scratch, name, (rows, surfaces, cols)) for name in ("intensity", "std"))
    background = np.empty((rows, cols), np.float32)
    clutter = np.full(1, ONE) if data.clutter is None else data.clutter
    _settle(photons, data.exposure, clutter, F32(enough), data.num_bins, state, own, around, bent, intensity, std,
            background)
    return intensity, std, background


@parallel
def _count(intensity, counts):
    rows, surfaces, cols = intensity.shape
    for i in prange(rows):
        found = 0
        for k in range(surfaces):
            for j in range(cols):
                found += 1 if intensity[i, k, j] > ZERO else 0
        counts[i] = found


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
    """The points, sorted by pixel, the strongest of a pixel first.

    Args:
        state: float32 [rows', K, FIELDS, cols'], gives the depths.
        intensity, std: of `settle`.
        rays: float32 [rows, cols, 3], unit vectors.
        metres_per_bin, metres: range = metres_per_bin · depth + metres.
        num_bins: T.

    Returns:
        row, col (uint16 [N]), rank (uint8 [N]), values (float32 [5, N]): depth, intensity, std, slopes down and to the
        right, bins and photons; xyz, float32 [N, 3], metres.
    """
    counts = np.empty(len(intensity), np.int64)
    _count(intensity, counts)
    ends = np.cumsum(counts)
    points = int(ends[-1])
    row, col = (np.empty(points, np.uint16) for _ in range(2))
    rank = np.empty(points, np.uint8)
    values, xyz = np.empty((5, points), np.float32), np.empty((points, 3), np.float32)
    _collect(state, intensity, std, rays, metres_per_bin, metres, num_bins, ends - counts, row, col, rank, values, xyz)
    return row, col, rank, values, xyz
