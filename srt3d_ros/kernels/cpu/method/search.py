"""One scale of the start: pool the sketches of open pixels, match them, and give sure pools' pixels their surface."""

from typing import NamedTuple

import numpy as np
from numba import boolean, float32, int64, prange, types

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import SEEN_SCORE, SLANT, SLANTED_SCORE, STEEPER, SURE_SCORE, VOTE
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, HALF, ONE, TWO, ZERO, aligned
from srt3d_ros.kernels.cpu.compiling import line, parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.method.blur import pool
from srt3d_ros.kernels.cpu.method.frame import FRAME, as_compiled
from srt3d_ros.kernels.cpu.method.likelihood import evidence, noise_at
from srt3d_ros.kernels.cpu.method.match import peaks, peaks_scratch, response_at, steering
from srt3d_ros.kernels.maps import BLOCK, DEPTH, INTENSITY, MARGIN, SCORE, SLOPE_COL, SLOPE_ROW, STD

STEERING = types.Tuple((float32[:, ::1], float32[:, ::1], boolean[::1], int64))
SLANTS = 3                  # falling, flat and rising, in each direction
ROOT_STEEPER = F32(STEEPER**0.5)
SEEN = F32(SEEN_SCORE)


class Scale(NamedTuple):
    """What one scale of the start searches, and what is enough for it."""

    cells: float32[:, :, ::1]           # [rows of cells, 2m + 2, cells], sums over open pixels
    pools: float32[:, :, ::1]           # and windows of them
    wanted: boolean[:, ::1]             # pixels that are open
    state: float32[:, :, :, ::1]
    carried: float32[:, :, :, ::1]      # the last frame's; empty: none
    turns: float32[:, :, ::1]           # [m, reach, 3] of `_turns`; or [0, …]: no slanted windows
    rise: float32                       # of slanted windows, bins per pixel
    layer: int64
    step: int64                         # pixels along the side of a cell
    share: float32
    enough: float32
    confirmed: float32


SCALE = types.NamedTuple(tuple(Scale.__annotations__.values()), Scale)


@line
def _list_cells(sketch, places, photons, share, least, frame, bound, listed):
    """List which of the cells at these places may reach their least score: R(z, t) ≤ Σ_l |z_l| at any depth t."""
    found, m = 0, len(frame.energy)
    bound[:] = ZERO
    for l in range(m):
        re, im = sketch[l], sketch[m + l]
        for x in range(len(places)):
            bound[x] += np.sqrt(re[x] * re[x] + im[x] * im[x])
    for x in range(len(places)):
        j = places[x]
        if evidence(bound[x], photons[j] / share, photons[j], frame) > least[j]:
            listed[found] = x
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


@line
def _ask(i, scale, sure, places):
    """Write the cells of row i with an open pixel whose surface, if it has found one, has a score below `sure`."""
    found, (rows, cols), step, state = 0, scale.wanted.shape, scale.step, scale.state
    for j in range(scale.pools.shape[2]):
        asks = False
        for a in range(i * step, min((i + 1) * step, rows)):
            for b in range(j * step, min((j + 1) * step, cols)):
                score = state[a + MARGIN, scale.layer, SCORE, b + MARGIN]
                is_open = state[a + MARGIN, scale.layer, INTENSITY, b + MARGIN] == ZERO
                asks |= scale.wanted[a, b] and (is_open or score < sure)
        if asks:
            places[found] = j
            found += 1
    return found


@line
def _search_row(i, sketch, slopes, places, least, flat, scale, scratch, frame, steering):
    """Match the cells of row i at these places that may reach their `least` score, and give their pixels what does.

    `sketch` is theirs, [2m, ≥ places]; `flat` takes the scores of flat windows.
    """
    (cos, sin, odd, turn), (slope_col, slope_row), period, m = steering, slopes, frame.period, len(frame.energy)
    of_peaks, z, place, height, bound, listed = scratch
    (rows, cols), step, warm = scale.wanted.shape, scale.step, len(scale.carried) > 0
    is_flat = slope_col == ZERO and slope_row == ZERO
    photons, light = scale.pools[i, 2 * m], scale.pools[i, 2 * m + 1]
    found = _list_cells(sketch, places, photons, scale.share, least, frame, bound, listed)
    for first in range(0, found, BLOCK):
        block = min(BLOCK, found - first)
        for c in range(2 * m):
            for x in range(BLOCK):
                z[c * BLOCK + x] = sketch[c, listed[first + x]] if x < block else ZERO
        peaks(z, cos, sin, odd, turn, period, of_peaks, place, height)
        for x in range(block):
            j = places[listed[first + x]]
            cell = photons[j], scale.share, max(light[j], EPSILON)
            score = _score(height[x], place[x] - period * np.floor(place[x] / period), cell, frame)
            enough = scale.enough if is_flat else least[j]
            if is_flat:
                flat[j] = score
            for a in range(i * step, min((i + 1) * step, rows)):
                for b in range(j * step, min((j + 1) * step, cols)):
                    if not scale.wanted[a, b]:
                        continue
                    point = scale.state[a + MARGIN, scale.layer, :, b + MARGIN]
                    if warm and _stays(z, x, score, cell, scale.confirmed,
                                       scale.carried[a + MARGIN, scale.layer, :, b + MARGIN], frame, point):
                        continue
                    known = point[SCORE] if point[INTENSITY] > ZERO else ZERO
                    if score > max(enough, known):
                        right = F32(b - j * step) - HALF * F32(step - 1)
                        down = F32(a - i * step) - HALF * F32(step - 1)
                        t = place[x] + slope_col * right + slope_row * down
                        _measure(t - period * np.floor(t / period), slope_col, slope_row,
                                 height[x] / frame.total_energy, score, cell, frame, point)


@line
def _add_pair(before, after, turn, sums):
    """Add rows that lie as far before as after: w cos φ (z₊ + z₋), w sin φ (z₊ − z₋) and w (z₊ + z₋).

    For few enough arrays a loop, that the compiler sees that none overlap.
    """
    (weight, cosine, sine), (even, odd, flat, both) = turn, sums
    for j in range(len(before)):
        both[j] = after[j] + before[j]
    for j in range(len(before)):
        odd[j] += sine * (after[j] - before[j])
    for j in range(len(before)):
        even[j] += cosine * both[j]
        flat[j] += weight * both[j]


@line
def _write_pools(re, im, sums, l, m, pools):
    """Write the windows along lines that fall, stay and rise: Σ w z exp(iφ), Σ w z and Σ w z exp(−iφ)."""
    (even_re, odd_re, flat_re, _), (even_im, odd_im, flat_im, _) = sums[:4], sums[4:]
    for j in range(len(re)):
        even_re[j] += re[j]
        flat_re[j] += re[j]
    for j in range(len(im)):
        even_im[j] += im[j]
        flat_im[j] += im[j]
    for way, sign in ((0, -ONE), (2, ONE)):
        real, imaginary = pools[way, l], pools[way, m + l]
        for j in range(len(re)):
            real[j] = even_re[j] + sign * odd_im[j]
        for j in range(len(im)):
            imaginary[j] = even_im[j] - sign * odd_re[j]
    pools[1, l, :len(re)], pools[1, m + l, :len(re)] = flat_re[:len(re)], flat_im[:len(re)]


@line
def _pool_down(i, cells, turns, nothing, sums, lines):
    """Sum the rows of cells around row i along three slopes: [SLANTS, 2m, margin + cells + margin]."""
    m, reach, _ = turns.shape
    for l in range(m):
        sums[:] = ZERO
        for part in range(2):
            channel = part * m + l
            for d in range(1, reach + 1):
                before = cells[i - d, channel] if i >= d else nothing
                after = cells[i + d, channel] if i + d < len(cells) else nothing
                _add_pair(before, after, turns[l, d - 1], sums[4 * part:4 * part + 4])
        _write_pools(cells[i, l], cells[i, m + l], sums, l, m, lines[:, :, reach:])


@line
def _pool_across(lines, turns, places, near, sums, pools):
    """Sum the cells of lines around those at these places along three slopes: [SLANTS, 2m, places]."""
    m, reach, _ = turns.shape
    before, after, middle = near[0, :len(places)], near[1, :len(places)], near[2:, :len(places)]
    for l in range(m):
        sums[:] = ZERO
        for part in range(2):
            row = lines[part * m + l]
            for d in range(1, reach + 1):
                for x in range(len(places)):
                    before[x], after[x] = row[places[x] + reach - d], row[places[x] + reach + d]
                _add_pair(before, after, turns[l, d - 1], sums[4 * part:4 * part + 4])
            for x in range(len(places)):
                middle[part, x] = row[places[x] + reach]
        _write_pools(middle[0], middle[1], sums, l, m, pools)


@line
def _search_slanted(i, places, least, flat, scale, scratch, frame, steering):
    """Search row i with windows along planes that rise or fall to the right, downwards or both."""
    (m, reach, _), width = scale.turns.shape, scale.pools.shape[2]
    lines = np.zeros((SLANTS, 2 * m, width + 2 * reach), np.float32)
    pools, sums = np.empty((SLANTS, 2 * m, width), np.float32), np.empty((8, width), np.float32)
    near = np.zeros((4, width), np.float32)
    _pool_down(i, scale.cells, scale.turns, near[0], sums, lines)
    for down in range(SLANTS):
        _pool_across(lines[down], scale.turns, places, near, sums, pools)
        for right in range(SLANTS):
            if down != SLANTS // 2 or right != SLANTS // 2:
                slopes = F32(right - SLANTS // 2) * scale.rise, F32(down - SLANTS // 2) * scale.rise
                _search_row(i, pools[right], slopes, places, least, flat, scale, scratch, frame, steering)


@parallel
def _search(frame: FRAME, scale: SCALE, steering: STEERING):
    m, width = len(frame.energy), scale.pools.shape[2]
    for i in prange(len(scale.pools)):
        places, least, flat = np.empty(width, np.int64), np.empty(width, np.float32), np.zeros(width, np.float32)
        asked = _ask(i, scale, ZERO, places)
        if asked == 0:
            continue
        scratch = (peaks_scratch(steering[3]), aligned(2 * m * BLOCK), aligned(BLOCK), aligned(BLOCK),
                   np.empty(width, np.float32), np.empty(width, np.int64))
        sketch = np.empty((2 * m, width), np.float32)
        for c in range(2 * m):
            for x in range(asked):
                sketch[c, x] = scale.pools[i, c, places[x]]
        least[:] = min(scale.enough, scale.confirmed) if len(scale.carried) > 0 else scale.enough
        if len(scale.turns) > 0:
            least[:] = min(scale.enough, SEEN)
        _search_row(i, sketch, (ZERO, ZERO), places[:asked], least, flat, scale, scratch, frame, steering)
        if len(scale.turns) == 0:
            continue
        doubtful = 0
        for x in range(_ask(i, scale, F32(SURE_SCORE), places)):
            j = places[x]
            least[j] = max(F32(SLANTED_SCORE), ROOT_STEEPER * flat[j])
            if flat[j] > SEEN:
                places[doubtful] = j
                doubtful += 1
        if doubtful > 0:
            _search_slanted(i, places[:doubtful], least, flat, scale, scratch, frame, steering)


def no_surfaces(frame, surfaces):
    return borrow("state", maps.state_shape(*frame.shape, surfaces), True)


def search(frame, matched, state, layer, sigma, step, enough, carried=None, confirmed=0.0, slanted=False):
    """The cells of a row that may be sure are matched together, BLOCK at a time."""
    wanted = (maps.crop(frame.exposure, *frame.shape) > 0) & (maps.crop(state, *frame.shape)[:, layer, INTENSITY] == 0)
    if layer > 0:
        wanted &= maps.crop(state, *frame.shape)[:, layer - 1, INTENSITY] > 0
    if not wanted.any():
        return
    weights = maps.window_weights(sigma / step) if sigma > 0 else np.ones(1, np.float32)
    cells, pools = pool(frame, matched, wanted, weights, step)
    rise = SLANT * frame.resolution_bins / sigma if slanted else 0.0
    turns = _turns(weights, frame.bin_frequencies * (step * rise)) if slanted else np.empty((0, 1, 3), np.float32)
    carried = np.empty((0, 0, 0, 0), np.float32) if carried is None else carried
    scale = Scale(cells, pools, wanted, state, carried, turns, F32(rise), layer, step, HALF if sigma > 0 else ONE,
                  F32(enough), F32(confirmed))
    _search(as_compiled(frame), scale, steering(frame.bin_frequencies, frame.num_bins))


def _turns(weights, turns):
    """A window's weights by the distance of cells, 1 … reach, times 1, cos φ and sin φ: a slope turns phases by φ."""
    apart = np.arange(1, len(weights) // 2 + 1)
    phase = 2 * np.pi * np.outer(turns, apart)
    ways = np.stack([np.ones_like(phase), np.cos(phase), np.sin(phase)], axis=2)
    return np.ascontiguousarray(weights[len(weights) // 2 + apart][:, None] * ways, np.float32)
