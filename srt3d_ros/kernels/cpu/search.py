"""One scale of the start: pool the sketches of open pixels, match them, and give sure pools' pixels their surface."""

import numpy as np
from numba import boolean, float32, int64, prange, types

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import START_SCORE, SURE_SCORE, VOTE
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, HALF, ONE, TWO, ZERO, aligned
from srt3d_ros.kernels.cpu.blur import pool, pool_slanted
from srt3d_ros.kernels.cpu.compiling import line, parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.frame import FRAME, as_compiled
from srt3d_ros.kernels.cpu.likelihood import evidence, noise_at
from srt3d_ros.kernels.cpu.match import peaks, peaks_scratch, response_at, steering
from srt3d_ros.kernels.maps import BLOCK, DEPTH, INTENSITY, MARGIN, SCORE, SLOPE_COL, SLOPE_ROW, STD

STEERING = types.Tuple((float32[:, ::1], float32[:, ::1], boolean[::1], int64))


@line
def _list_cells(sketch, photons, i, step, share, enough, wanted, frame, bound, listed):
    """List the cells of row i with a wanted pixel that may be sure: R(z, t) is at most Σ_l |z_l| at any depth t."""
    found, cells, m = 0, len(bound), len(frame.energy)
    bound[:] = ZERO
    for l in range(m):
        for j in range(cells):
            re, im = sketch[l, j], sketch[m + l, j]
            bound[j] += np.sqrt(re * re + im * im)
    for j in range(cells):
        if evidence(bound[j], photons[j] / share, photons[j], frame) > enough:
            for a in range(i * step, min((i + 1) * step, wanted.shape[0])):
                for b in range(j * step, min((j + 1) * step, wanted.shape[1])):
                    if wanted[a, b] and (found == 0 or listed[found - 1] != j):
                        listed[found] = j
                        found += 1
    return found


@line
def _score(response, depth, cell, frame):
    """The score of a response of a cell's photons, before the clutter at this depth."""
    photons, share, _ = cell
    return evidence(response, photons / share, photons, frame) / noise_at(frame, depth)


@line
def _measure(depth, slope_col, slope_row, signal, score, cell, frame, point):
    """Write the surface of a pixel that has so much signal in its cell."""
    photons, share, light = cell
    by_signal = max(signal, EPSILON)
    by_background = max(photons / share - by_signal, ZERO)
    spread = share * (by_signal * frame.moments[0] + by_background * frame.moments[1])
    point[DEPTH], point[SLOPE_COL], point[SLOPE_ROW] = depth, slope_col, slope_row
    point[INTENSITY], point[SCORE] = signal / light, score
    point[STD] = min(np.sqrt(spread) / (by_signal * frame.curvature), frame.period)


@line
def _stays(z, x, score, cell, confirmed, old, frame, point):
    """Keep the last frame's surface of a pixel if the cell's photons confirm it, and its rival is not better."""
    if old[INTENSITY] == ZERO:
        return False
    response = response_at(z, x, BLOCK, frame.bin_frequencies, old[DEPTH])
    known = _score(response, old[DEPTH], cell, frame)
    if known <= confirmed or score * score - known * known >= TWO * F32(VOTE):
        return False
    _measure(old[DEPTH], old[SLOPE_COL], old[SLOPE_ROW], response / frame.total_energy, known, cell, frame, point)
    return True


@parallel
def _search(frame: FRAME, sketches: float32[:, :, :, ::1], pools: float32[:, :, ::1], step: int64, share: float32,
            enough: float32, steering: STEERING, wanted: boolean[:, ::1], layer: int64, carried: float32[:, :, :, ::1],
            confirmed: float32, slopes: float32[:, ::1], state: float32[:, :, :, ::1]):
    (rows, cols), (cos, sin, odd, cells), period = wanted.shape, steering, frame.period
    m, width, warm = len(frame.energy), pools.shape[2], carried.shape[0] > 0
    least = min(enough, confirmed) if warm else enough
    for i in prange(len(pools)):
        scratch, z = peaks_scratch(cells), aligned(2 * m * BLOCK)
        place, height = aligned(BLOCK), aligned(BLOCK)
        bound, listed = np.empty(width, np.float32), np.empty(width, np.int64)
        photons, light = pools[i, 2 * m], pools[i, 2 * m + 1]
        for k in range(len(slopes)):
            found = _list_cells(sketches[k, i], photons, i, step, share, least, wanted, frame, bound, listed)
            for first in range(0, found, BLOCK):
                block = min(BLOCK, found - first)
                for c in range(2 * m):
                    for x in range(BLOCK):
                        z[c * BLOCK + x] = sketches[k, i, c, listed[first + x]] if x < block else ZERO
                peaks(z, cos, sin, odd, cells, period, scratch, place, height)
                for x in range(block):
                    j = listed[first + x]
                    cell = photons[j], share, max(light[j], EPSILON)
                    score = _score(height[x], place[x] - period * np.floor(place[x] / period), cell, frame)
                    for a in range(i * step, min((i + 1) * step, rows)):
                        for b in range(j * step, min((j + 1) * step, cols)):
                            if not wanted[a, b]:
                                continue
                            point = state[a + MARGIN, layer, :, b + MARGIN]
                            if warm and _stays(z, x, score, cell, confirmed, carried[a + MARGIN, layer, :, b + MARGIN],
                                               frame, point):
                                continue
                            if score > max(enough, point[SCORE] if point[INTENSITY] > ZERO else enough):
                                right = F32(b - j * step) - HALF * F32(step - 1)
                                down = F32(a - i * step) - HALF * F32(step - 1)
                                t = place[x] + slopes[k, 0] * right + slopes[k, 1] * down
                                _measure(t - period * np.floor(t / period), slopes[k, 0], slopes[k, 1],
                                         height[x] / frame.total_energy, score, cell, frame, point)


def no_surfaces(frame, surfaces):
    return borrow("state", maps.state_shape(*frame.shape, surfaces), True)


def search(frame, matched, state, layer, sigma, step, enough, carried=None, confirmed=0.0, slanted=False):
    """The cells of a row that may be sure are matched together, BLOCK at a time."""
    intensity, score = (maps.crop(state, *frame.shape)[:, :, f] for f in (INTENSITY, SCORE))
    wanted = (maps.crop(frame.exposure, *frame.shape) > 0) & (intensity[:, layer] == 0)
    if layer > 0:
        wanted &= intensity[:, layer - 1] > 0
    if not wanted.any():
        return
    weights = maps.window_weights(sigma / step) if sigma > 0 else np.ones(1, np.float32)
    cells, pools = pool(frame, matched, wanted, weights, step)
    carried = np.empty((0, 0, 0, 0), np.float32) if carried is None else carried
    compiled, filters = as_compiled(frame), steering(frame.bin_frequencies, frame.num_bins)

    def along(slopes, sketches, enough):
        _search(compiled, sketches, pools, step, HALF if sigma > 0 else ONE, F32(enough), filters, wanted, layer,
                carried, F32(confirmed), slopes, state)

    along(np.zeros((1, 2), np.float32), pools[None], enough)
    if slanted:
        rise = frame.resolution_bins / sigma
        wanted &= (intensity[:, layer] == 0) | (score[:, layer] < SURE_SCORE)
        slopes = np.array([(rise, 0), (-rise, 0), (0, rise), (0, -rise)], np.float32)
        along(slopes, pool_slanted(cells, weights, frame.bin_frequencies * (step * rise), step, wanted), START_SCORE)
