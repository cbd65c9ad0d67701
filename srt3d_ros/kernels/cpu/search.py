"""One scale of the start: pool the sketches of open pixels, match them, and give sure pools' pixels their surface."""

import numpy as np
from numba import prange

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import START_SCORE, STAY, SURE_SCORE
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, HALF, ONE, TWO, ZERO, aligned, total_of
from srt3d_ros.kernels.cpu.blur import pool, pool_slanted
from srt3d_ros.kernels.cpu.compiling import line, parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.likelihood import evidence
from srt3d_ros.kernels.cpu.match import peaks, peaks_scratch, response_at, steering
from srt3d_ros.kernels.maps import BLOCK, DEPTH, INTENSITY, MARGIN, SCORE, SLOPE_COL, SLOPE_ROW, STD, window_weights


@line
def _std(signal, counts, share, moments, curvature, period):
    """Standard deviation of a depth found in a window, bins; signal Σ w r."""
    signal = max(signal, EPSILON)
    background = max(counts / share - signal, ZERO)
    spread = share * (signal * moments[0] + background * moments[1])
    return min(np.sqrt(spread) / (signal * curvature), period)


@line
def _list_cells(i, m, top, step, matched, counts, counts_at, wanted, share, enough, max_response, background_table,
                bound, listed):
    """List the cells of row i with a wanted pixel that may be sure: R(z, t) is at most Σ_l |z_l| at any depth t."""
    found, cells = 0, len(bound)
    bound[:] = ZERO
    for l in range(m):
        for j in range(cells):
            re, im = matched[top + i, l, top + j], matched[top + i, m + l, top + j]
            bound[j] += np.sqrt(re * re + im * im)
    for j in range(cells):
        photons = counts[top + i, counts_at, top + j]
        if evidence(bound[j], photons / share, photons, max_response, background_table) > enough:
            for a in range(i * step, min((i + 1) * step, wanted.shape[0])):
                for b in range(j * step, min((j + 1) * step, wanted.shape[1])):
                    if wanted[a, b] and (found == 0 or listed[found - 1] != j):
                        listed[found] = j
                        found += 1
    return found


@line
def _stays(z, x, a, b, layer, score, photons, share, light, confirmed, carried, energy, curvature, max_response,
           background_table, moments, clutter, bin_frequencies, period, state):
    """Keep the last frame's surface of pixel (a, b) if the cell's photons confirm it, and its rival is not better."""
    if carried[a, layer, INTENSITY, b] == ZERO:
        return False
    old, total = carried[a, layer, DEPTH, b], total_of(energy)
    response = response_at(z, x, BLOCK, bin_frequencies, old)
    known = evidence(response, photons / share, photons, max_response, background_table)
    known /= clutter[int(np.rint(old)) % len(clutter)]
    if known <= confirmed or score * score - known * known >= TWO * F32(STAY):
        return False
    for f in (DEPTH, SLOPE_COL, SLOPE_ROW):
        state[a, layer, f, b] = carried[a, layer, f, b]
    state[a, layer, INTENSITY, b] = response / total / light
    state[a, layer, STD, b] = _std(response / total, photons, share, moments, curvature, period)
    state[a, layer, SCORE, b] = known
    return True


@parallel
def _search(matched, counts, exposure, counts_at, exposure_at, top, step, share, enough, energy, curvature,
            max_response, background_table, moments, clutter, bin_frequencies, cos, sin, odd, cells, num_bins, wanted,
            layer, carried, confirmed, slopes, state):
    rows, cols = wanted.shape
    m, total, period = len(energy), total_of(energy), F32(num_bins)
    warm = carried.shape[0] > 0
    least = min(enough, confirmed) if warm else enough
    for i in prange(-(-rows // step)):
        scratch, z = peaks_scratch(cells), aligned(2 * m * BLOCK)
        place, height = aligned(BLOCK), aligned(BLOCK)
        width = -(-cols // step)
        bound, listed = np.empty(width, np.float32), np.empty(width, np.int64)
        for k in range(len(slopes)):
            found = _list_cells(i, m, top, step, matched[k], counts, counts_at, wanted, share, least, max_response,
                                background_table, bound, listed)
            for first in range(0, found, BLOCK):
                block = min(BLOCK, found - first)
                for c in range(2 * m):
                    for x in range(BLOCK):
                        z[c * BLOCK + x] = matched[k, top + i, c, top + listed[first + x]] if x < block else ZERO
                peaks(z, cos, sin, odd, cells, period, scratch, place, height)
                for x in range(block):
                    j = listed[first + x]
                    photons = counts[top + i, counts_at, top + j]
                    light = max(exposure[top + i, exposure_at, top + j], EPSILON)
                    depth = place[x] - period * np.floor(place[x] / period)
                    score = evidence(height[x], photons / share, photons, max_response, background_table)
                    score /= clutter[int(np.rint(depth)) % len(clutter)]
                    for a in range(i * step + MARGIN, min((i + 1) * step, rows) + MARGIN):
                        for b in range(j * step + MARGIN, min((j + 1) * step, cols) + MARGIN):
                            if not wanted[a - MARGIN, b - MARGIN]:
                                continue
                            if warm and _stays(z, x, a, b, layer, score, photons, share, light, confirmed, carried,
                                               energy, curvature, max_response, background_table, moments, clutter,
                                               bin_frequencies, period, state):
                                continue
                            rival = state[a, layer, SCORE, b] if state[a, layer, INTENSITY, b] > ZERO else enough
                            if score > max(enough, rival):
                                right = F32(b - MARGIN - j * step) - HALF * F32(step - 1)
                                down = F32(a - MARGIN - i * step) - HALF * F32(step - 1)
                                t = depth + slopes[k, 0] * right + slopes[k, 1] * down
                                state[a, layer, DEPTH, b] = t - period * np.floor(t / period)
                                state[a, layer, SLOPE_COL, b], state[a, layer, SLOPE_ROW, b] = slopes[k]
                                signal = height[x] / total
                                state[a, layer, INTENSITY, b] = signal / light
                                state[a, layer, STD, b] = _std(signal, photons, share, moments, curvature, period)
                                state[a, layer, SCORE, b] = score


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
    is_open = wanted.astype(np.float32)         # these are pooled even when they have found a surface
    carried = np.empty((0, 0, 0, 0), np.float32) if carried is None else carried
    clutter = np.ones(1, np.float32) if frame.clutter is None else frame.clutter
    flat = np.zeros((1, 2), np.float32)

    def along(slopes, matched, counts, exposure, at, top, share, enough):
        _search(matched, counts, exposure, *at, top, step, share, F32(enough), frame.energy, F32(frame.curvature),
                F32(frame.max_response), frame.background_table, frame.moments, clutter, frame.bin_frequencies,
                *steering(frame.bin_frequencies, frame.num_bins), frame.num_bins, wanted, layer, carried,
                F32(confirmed), slopes, state)

    if sigma == 0:
        along(flat, matched[None], frame.counts[:, None], frame.exposure[:, None], (0, 0), MARGIN, ONE, enough)
        return
    weights, channels = window_weights(sigma / step), matched.shape[1]
    cells, pools = pool(matched, frame.counts, frame.exposure, is_open, weights, step, wanted)
    of_pools = pools, pools, (channels, channels + 1), 0, HALF
    along(flat, pools[None], *of_pools, enough)
    if slanted:
        rise = frame.resolution_bins / sigma
        wanted &= (intensity[:, layer] == 0) | (score[:, layer] < SURE_SCORE)
        slopes = np.array([(rise, 0), (-rise, 0), (0, rise), (0, -rise)], np.float32)
        along(slopes, pool_slanted(cells, weights, frame.bin_frequencies * (step * rise), step, wanted), *of_pools,
              START_SCORE)


def drop_weak(state, weak):
    state[:, :, INTENSITY] *= state[:, :, SCORE] >= F32(weak)
