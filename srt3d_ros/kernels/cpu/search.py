"""One scale of the start: pool the sketches of open pixels, match them, and give sure pools' pixels their surface."""

import numpy as np
from numba import prange

from srt3d_ros.kernels.constants import APART, FAINTEST, STAY
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, HALF, ONE, TWO, ZERO, aligned, total_of, wrap
from srt3d_ros.kernels.cpu.blur import pool
from srt3d_ros.kernels.cpu.compiling import line, parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.likelihood import surprise
from srt3d_ros.kernels.cpu.match import peaks, peaks_scratch, response_at, steering
from srt3d_ros.kernels.maps import BLOCK, DEPTH, INTENSITY, MARGIN, SCORE, SLOPE_COL, SLOPE_ROW, STD, window_weights


@parallel
def _find_open(exposure, state, layer, is_open):
    rows, cols = is_open.shape
    for i in prange(rows):
        a = i + MARGIN
        for j in range(cols):
            b = j + MARGIN
            found = exposure[a, b] > ZERO and state[a, layer, INTENSITY, b] == ZERO
            if layer > 0:
                found = found and state[a, layer - 1, INTENSITY, b] > ZERO
            is_open[i, j] = ONE if found else ZERO


@line
def _score(response, counts, share, max_response, background_table):
    """Evidence of a response Σ w R of Σ w² n counts against "background alone", in σ; share is Σ w² / Σ w."""
    photons = max(counts / share, EPSILON)
    return np.sqrt(photons / share) * surprise(response / (photons * max_response), background_table)


@line
def _std(signal, counts, share, moments, curvature, period):
    """Standard deviation of a depth found in a window, bins; signal Σ w r."""
    signal = max(signal, EPSILON)
    background = max(counts / share - signal, ZERO)
    spread = share * (signal * moments[0] + background * moments[1])
    return min(np.sqrt(spread) / (signal * curvature), period)


@line
def _is_new(state, a, layer, b, depth, intensity, apart, period):
    """Whether a surface stands beside those that pixel (a, b) already has: resolved from them, and not too faint."""
    new = layer == 0 or intensity > FAINTEST * state[a, 0, INTENSITY, b]
    for k in range(layer):
        near = abs(wrap(state[a, k, DEPTH, b] - depth, period)) <= apart
        new = new and not (near and state[a, k, INTENSITY, b] > ZERO)
    return new


@line
def _list_cells(i, m, top, step, matched, counts, counts_at, is_open, share, enough, max_response, background_table,
                bound, listed):
    """List the cells of row i with an open pixel that may be sure: R(z, t) is at most Σ_l |z_l| at any depth t."""
    found, cells = 0, len(bound)
    bound[:] = ZERO
    for l in range(m):
        for j in range(cells):
            re, im = matched[top + i, l, top + j], matched[top + i, m + l, top + j]
            bound[j] += np.sqrt(re * re + im * im)
    for j in range(cells):
        if _score(bound[j], counts[top + i, counts_at, top + j], share, max_response, background_table) > enough:
            for a in range(i * step, min((i + 1) * step, is_open.shape[0])):
                for b in range(j * step, min((j + 1) * step, is_open.shape[1])):
                    if is_open[a, b] > ZERO and (found == 0 or listed[found - 1] != j):
                        listed[found] = j
                        found += 1
    return found


@parallel
def _search(matched, counts, exposure, counts_at, exposure_at, top, step, share, enough, energy, curvature,
            max_response, background_table, moments, clutter, bin_frequencies, cos, sin, odd, cells, num_bins, is_open,
            layer, carried, confirmed, state):
    rows, cols = is_open.shape
    m, total, period = len(energy), total_of(energy), F32(num_bins)
    apart, warm = APART * np.sqrt(total / curvature), carried.shape[0] > 0
    least = min(enough, confirmed) if warm else enough
    for i in prange(-(-rows // step)):
        scratch, z = peaks_scratch(cells), aligned(2 * m * BLOCK)
        place, height = aligned(BLOCK), aligned(BLOCK)
        width = -(-cols // step)
        bound, listed = np.empty(width, np.float32), np.empty(width, np.int64)
        found = _list_cells(i, m, top, step, matched, counts, counts_at, is_open, share, least, max_response,
                            background_table, bound, listed)
        for first in range(0, found, BLOCK):
            block = min(BLOCK, found - first)
            for c in range(2 * m):
                for x in range(BLOCK):
                    z[c * BLOCK + x] = matched[top + i, c, top + listed[first + x]] if x < block else ZERO
            peaks(z, cos, sin, odd, cells, period, scratch, place, height)
            for x in range(block):
                j = listed[first + x]
                photons = counts[top + i, counts_at, top + j]
                light = max(exposure[top + i, exposure_at, top + j], EPSILON)
                depth = place[x] - period * np.floor(place[x] / period)
                score = _score(height[x], photons, share, max_response, background_table)
                score /= clutter[int(np.rint(depth)) % len(clutter)]
                signal = height[x] / total
                for a in range(i * step + MARGIN, min((i + 1) * step, rows) + MARGIN):
                    for b in range(j * step + MARGIN, min((j + 1) * step, cols) + MARGIN):
                        if is_open[a - MARGIN, b - MARGIN] == ZERO:
                            continue
                        if warm and carried[a, layer, INTENSITY, b] > ZERO:
                            old = carried[a, layer, DEPTH, b]
                            response = response_at(z, x, BLOCK, bin_frequencies, old)
                            known = _score(response, photons, share, max_response, background_table)
                            known /= clutter[int(np.rint(old)) % len(clutter)]
                            if known > confirmed and score * score - known * known < TWO * F32(STAY):
                                for f in (DEPTH, SLOPE_COL, SLOPE_ROW):
                                    state[a, layer, f, b] = carried[a, layer, f, b]
                                state[a, layer, INTENSITY, b] = response / total / light
                                state[a, layer, STD, b] = _std(response / total, photons, share, moments, curvature,
                                                               period)
                                state[a, layer, SCORE, b] = known
                                continue
                        if score > enough and _is_new(state, a, layer, b, depth, signal / light, apart, period):
                            state[a, layer, DEPTH, b] = depth
                            state[a, layer, SLOPE_COL, b], state[a, layer, SLOPE_ROW, b] = ZERO, ZERO
                            state[a, layer, INTENSITY, b] = signal / light
                            state[a, layer, STD, b] = _std(signal, photons, share, moments, curvature, period)
                            state[a, layer, SCORE, b] = score


def drop_weak(state, weak):
    state[:, :, INTENSITY] *= state[:, :, SCORE] >= F32(weak)


def search(frame, matched, state, layer, sigma, step, enough, scratch=None, carried=None, confirmed=0.0):
    """The cells of a row that may be sure are matched together, BLOCK at a time."""
    rows, cols = frame.shape
    carried = np.empty((0, 0, 0, 0), np.float32) if carried is None else carried
    is_open = borrow(scratch, "open", (rows, cols))
    _find_open(frame.exposure, state, layer, is_open)
    if not is_open.any():
        return
    maps, channels = (matched, frame.counts[:, None], frame.exposure[:, None]), (0, 0)
    top, share = MARGIN, ONE
    if sigma > 0:
        pools = pool(matched, frame.counts, frame.exposure, is_open, window_weights(sigma / step), step, scratch)
        maps, channels = (pools, pools, pools), (matched.shape[1], matched.shape[1] + 1)
        top, share = 0, HALF
    clutter = np.ones(1, np.float32) if frame.clutter is None else frame.clutter
    _search(*maps, *channels, top, step, share, F32(enough), frame.energy, F32(frame.curvature),
            F32(frame.max_response), frame.background_table, frame.moments, clutter, frame.bin_frequencies,
            *steering(frame.bin_frequencies, frame.num_bins), frame.num_bins, is_open, layer, carried, F32(confirmed),
            state)
