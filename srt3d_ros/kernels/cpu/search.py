"""One scale of the start: pool the sketches of open pixels, match them, and give sure pools' pixels their surface."""

import numpy as np
from numba import prange

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import APART, DOUBTFUL, SLANTS, STAY, SURE_SLANTED
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, HALF, ONE, TWO, ZERO, aligned, total_of, wrap
from srt3d_ros.kernels.cpu.blur import pool, rows_of_pools
from srt3d_ros.kernels.cpu.compiling import line, parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.likelihood import evidence
from srt3d_ros.kernels.cpu.match import peaks, peaks_scratch, response_at, steering
from srt3d_ros.kernels.maps import BLOCK, DEPTH, INTENSITY, MARGIN, SCORE, SLOPE_COL, SLOPE_ROW, STD, window_weights


@parallel
def _find_open(exposure, before, state, layer, is_open, wanted):
    """Write 1 for the pixels that were open before, and for those of them that want a surface, or a better one."""
    rows, cols = is_open.shape
    for i in prange(rows):
        a = i + MARGIN
        for j in range(cols):
            b = j + MARGIN
            found = exposure[a, b] > ZERO and before[a, layer, INTENSITY, b] == ZERO
            if layer > 0:
                found = found and before[a, layer - 1, INTENSITY, b] > ZERO
            sure = state[a, layer, INTENSITY, b] > ZERO and state[a, layer, SCORE, b] >= F32(DOUBTFUL)
            is_open[i, j] = ONE if found else ZERO
            wanted[i, j] = ONE if found and not sure else ZERO


@parallel
def _shear(matched, cos_col, sin_col, cos_row, sin_row, near, step, out):
    """z exp(−i (φ_col + φ_row)), in rows of cells that are `near`."""
    padded_rows, channels, cols = matched.shape
    m = channels // 2
    for row in prange(padded_rows - 2 * MARGIN):
        if not near[row // step]:
            continue
        i = row + MARGIN
        for l in range(m):
            cosine, sine = cos_row[l, i], sin_row[l, i]
            for j in range(cols):
                c = cosine * cos_col[l, j] - sine * sin_col[l, j]
                s = cosine * sin_col[l, j] + sine * cos_col[l, j]
                re, im = matched[i, l, j], matched[i, m + l, j]
                out[i, l, j] = re * c + im * s
                out[i, m + l, j] = im * c - re * s


def _sheared(matched, bin_frequencies, slope, near, step):
    """The map with a plane of this slope turned to depth 0, in rows of cells that are `near`."""
    turns = 2 * np.pi * bin_frequencies.astype(np.float64)[:, None]
    col, row = (turns * (rise * (np.arange(pixels) - MARGIN)) for rise, pixels in
                zip(slope, (matched.shape[2], matched.shape[0])))
    out = borrow("sheared", matched.shape)
    _shear(matched, *(f(phase).astype(np.float32) for phase in (col, row) for f in (np.cos, np.sin)), near,
           step, out)
    return out


@line
def _std(signal, counts, share, moments, curvature, period):
    """Standard deviation of a depth found in a window, bins; signal Σ w r."""
    signal = max(signal, EPSILON)
    background = max(counts / share - signal, ZERO)
    spread = share * (signal * moments[0] + background * moments[1])
    return min(np.sqrt(spread) / (signal * curvature), period)


@line
def _is_new(state, a, layer, b, depth, apart, period):
    """Whether a surface is resolved from those that pixel (a, b) already has."""
    new = True
    for k in range(layer):
        near = abs(wrap(state[a, k, DEPTH, b] - depth, period)) <= apart
        new = new and not (near and state[a, k, INTENSITY, b] > ZERO)
    return new


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
                    if wanted[a, b] > ZERO and (found == 0 or listed[found - 1] != j):
                        listed[found] = j
                        found += 1
    return found


@parallel
def _search(matched, counts, exposure, counts_at, exposure_at, top, step, share, enough, energy, curvature,
            max_response, background_table, moments, clutter, bin_frequencies, cos, sin, odd, cells, num_bins, wanted,
            layer, carried, confirmed, slope, state):
    rows, cols = wanted.shape
    m, total, period = len(energy), total_of(energy), F32(num_bins)
    apart, warm = APART * np.sqrt(total / curvature), carried.shape[0] > 0
    least = min(enough, confirmed) if warm else enough
    for i in prange(-(-rows // step)):
        scratch, z = peaks_scratch(cells), aligned(2 * m * BLOCK)
        place, height = aligned(BLOCK), aligned(BLOCK)
        width = -(-cols // step)
        bound, listed = np.empty(width, np.float32), np.empty(width, np.int64)
        found = _list_cells(i, m, top, step, matched, counts, counts_at, wanted, share, least, max_response,
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
                depth = place[x] + F32(step) * (slope[0] * F32(j) + slope[1] * F32(i))
                depth -= period * np.floor(depth / period)
                score = evidence(height[x], photons / share, photons, max_response, background_table)
                score /= clutter[int(np.rint(depth)) % len(clutter)]
                signal = height[x] / total
                for a in range(i * step + MARGIN, min((i + 1) * step, rows) + MARGIN):
                    for b in range(j * step + MARGIN, min((j + 1) * step, cols) + MARGIN):
                        if wanted[a - MARGIN, b - MARGIN] == ZERO:
                            continue
                        if warm and carried[a, layer, INTENSITY, b] > ZERO:
                            old = carried[a, layer, DEPTH, b]
                            response = response_at(z, x, BLOCK, bin_frequencies, old)
                            known = evidence(response, photons / share, photons, max_response,
                                             background_table)
                            known /= clutter[int(np.rint(old)) % len(clutter)]
                            if known > confirmed and score * score - known * known < TWO * F32(STAY):
                                for f in (DEPTH, SLOPE_COL, SLOPE_ROW):
                                    state[a, layer, f, b] = carried[a, layer, f, b]
                                state[a, layer, INTENSITY, b] = response / total / light
                                state[a, layer, STD, b] = _std(response / total, photons, share, moments, curvature,
                                                               period)
                                state[a, layer, SCORE, b] = known
                                continue
                        rival = state[a, layer, SCORE, b] if state[a, layer, INTENSITY, b] > ZERO else enough
                        new = score > max(enough, rival)
                        if new and _is_new(state, a, layer, b, depth, apart, period):
                            right, down = F32(b - MARGIN - j * step), F32(a - MARGIN - i * step)
                            t = depth + slope[0] * right + slope[1] * down
                            state[a, layer, DEPTH, b] = t - period * np.floor(t / period)
                            state[a, layer, SLOPE_COL, b], state[a, layer, SLOPE_ROW, b] = slope
                            state[a, layer, INTENSITY, b] = signal / light
                            state[a, layer, STD, b] = _std(signal, photons, share, moments, curvature, period)
                            state[a, layer, SCORE, b] = score


def drop_weak(state, weak):
    state[:, :, INTENSITY] *= state[:, :, SCORE] >= F32(weak)


def no_surfaces(frame, surfaces):
    return borrow("state", maps.state_shape(*frame.shape, surfaces), True)


def search(frame, matched, state, layer, sigma, step, enough, carried=None, confirmed=0.0, slanted=False):
    before = state
    if slanted:
        before = borrow("before", state.shape)
        before[:] = state
    _search_along(frame, matched, state, layer, sigma, step, enough, carried, confirmed, (0.0, 0.0), before)
    for slope in SLANTS if slanted else ():
        along = tuple(part * frame.resolution_bins / sigma for part in slope)
        _search_along(frame, matched, state, layer, sigma, step, SURE_SLANTED, None, 0.0, along, before)


def _search_along(frame, matched, state, layer, sigma, step, enough, carried, confirmed, slope, before):
    """The cells of a row that may be sure are matched together, BLOCK at a time."""
    rows, cols = frame.shape
    carried = np.empty((0, 0, 0, 0), np.float32) if carried is None else carried
    is_open, wanted = (borrow(name, (rows, cols)) for name in ("open", "wanted"))
    _find_open(frame.exposure, before, state, layer, is_open, wanted)
    if not wanted.any():
        return
    pools, channels = (matched, frame.counts[:, None], frame.exposure[:, None]), (0, 0)
    top, share = MARGIN, ONE
    if sigma > 0:
        weights = window_weights(sigma / step)
        needed, near = rows_of_pools(wanted, weights, step)
        if slope != (0.0, 0.0):
            matched = _sheared(matched, frame.bin_frequencies, slope, near, step)
        pools = (pool(matched, frame.counts, frame.exposure, is_open, weights, step, needed, near),) * 3
        channels = matched.shape[1], matched.shape[1] + 1
        top, share = 0, HALF
    clutter = np.ones(1, np.float32) if frame.clutter is None else frame.clutter
    _search(*pools, *channels, top, step, share, F32(enough), frame.energy, F32(frame.curvature),
            F32(frame.max_response), frame.background_table, frame.moments, clutter, frame.bin_frequencies,
            *steering(frame.bin_frequencies, frame.num_bins), frame.num_bins, wanted, layer, carried, F32(confirmed),
            (F32(slope[0]), F32(slope[1])), state)
