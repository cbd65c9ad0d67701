"""One scale of the start: `search` gives open pixels the surface that the window around them shows.

Windows of cells of pixels, z̄ = Σ w z, N = Σ w² n and G = Σ w g (`blur.pool`), are matched: t and S are depth and signal
of the highest peak. With q = Σ w² / Σ w and p = N / q,

    score = p / √N · ρ(S E / p) / c(t),    r = S / G,    std = √(q (S M₁ + (p − S)₊ M₀)) / (S C).

Since S E ≤ Σ_l |z̄_l|, most cells that cannot reach the score they need are found without a filter. After the flat
windows come slanted ones (`slanted`).
"""

from typing import NamedTuple

import numpy as np
from numba import boolean, float32, int64, prange

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import MOVE_COST, SEEN_SCORE, SLANT, SLANTED_SCORE, STEEPER, SURE_SCORE
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, HALF, ONE, TWO, ZERO, aligned
from srt3d_ros.kernels.cpu.compiling import line, parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.method.blur import pool
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.cpu.method.likelihood_scalar import evidence, noise_at
from srt3d_ros.kernels.cpu.method.match import Steering, peaks, peaks_scratch, response_at, steering
from srt3d_ros.kernels.cpu.method.slanted import SLANTS, pool_across, pool_down, turns_of
from srt3d_ros.kernels.maps import BLOCK, DEPTH, INTENSITY, MARGIN, SCORE, SLOPE_COL, SLOPE_ROW, STD

ROOT_STEEPER = F32(STEEPER**0.5)
SEEN = F32(SEEN_SCORE)


class Scale(NamedTuple):
    """What one scale of the start searches, and which scores it needs."""

    cells: float32[:, :, ::1]           # [rows of cells, 2m + 2, cells], sums over open pixels
    pools: float32[:, :, ::1]           # windows of them
    wanted: boolean[:, ::1]             # [rows, cols], whether a pixel is open
    state: float32[:, :, :, ::1]
    carried: float32[:, :, :, ::1]      # the last frame's state; [0, …] without one
    turns: float32[:, :, ::1]           # [m, reach, 3] of `turns_of`; [0, …] without slanted windows
    rise: float32                       # slope of slanted windows, bins per pixel
    layer: int64                        # index of the surface
    step: int64                         # pixels along the side of a cell
    share: float32                      # q
    enough: float32                     # score that a new surface needs
    confirmed: float32                  # score with which a carried surface stays


class Row(NamedTuple):
    """Memory of one thread for a row of cells; [cells] each, but the last three, which are of BLOCK cells."""

    least: np.ndarray       # score that a cell needs
    flat: np.ndarray        # score of a cell's flat window
    bound: np.ndarray       # Σ_l |z̄_l|
    listed: np.ndarray      # int64, indices into the places searched: those that may reach their least score
    z: np.ndarray           # [2m · BLOCK]
    peaks: tuple            # place, bins, and height
    scratch: tuple          # of `peaks_scratch`


@line
def _list_cells(sketch, places, needs, frame, bound, listed):
    """List which of the cells at these places may reach their least score; returns how many."""
    found, m, (photons, share, least) = 0, len(frame.energy), needs
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
    """The score of a cell's response R(z̄, depth) = S E."""
    photons, share, _ = cell
    return evidence(response, photons / share, photons, frame) / noise_at(frame, depth)


@line
def _measure(depth, slopes, signal, score, cell, frame, point):
    """Write the surface of a pixel in whose cell so much signal shows it."""
    (photons, share, light), (slope_col, slope_row) = cell, slopes
    by_signal = max(signal, EPSILON)
    by_background = max(photons / share - by_signal, ZERO)
    spread = share * (by_signal * frame.moments[0] + by_background * frame.moments[1])
    point[DEPTH], point[SLOPE_COL], point[SLOPE_ROW] = depth, slope_col, slope_row
    point[INTENSITY], point[SCORE] = signal / light, score
    point[STD] = min(np.sqrt(spread) / (by_signal * frame.curvature), frame.period)


@line
def _stays(sketch, score, cell, confirmed, old, frame, point):
    """Keep a pixel's surface of the last frame if its score is confirmed, and the new one not better by VOTE nats."""
    if old[INTENSITY] == ZERO:
        return False
    z, x = sketch
    response = response_at(z, x, BLOCK, frame.bin_frequencies, old[DEPTH])
    known = _score(response, old[DEPTH], cell, frame)
    if known <= confirmed or score * score - known * known >= TWO * F32(MOVE_COST):
        return False
    slopes = old[SLOPE_COL], old[SLOPE_ROW]
    _measure(old[DEPTH], slopes, response / frame.total_energy, known, cell, frame, point)
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
def _search_row(i, sketch, slopes, places, row, inputs):
    """Match the cells of row i at these places that may reach their least score; give their pixels what they show.

    `sketch` [2m, ≥ places] is theirs. Flat windows write their scores to `row.flat`.
    """
    (frame, scale, steering), (slope_col, slope_row) = inputs, slopes
    least, flat, bound, listed, z, (place, height), scratch = row
    wanted, state, carried, layer, step = scale.wanted, scale.state, scale.carried, scale.layer, scale.step
    (rows, cols), warm, period, m = wanted.shape, len(carried) > 0, frame.period, len(frame.energy)
    is_flat = slope_col == ZERO and slope_row == ZERO
    photons, light = scale.pools[i, 2 * m], scale.pools[i, 2 * m + 1]
    found = _list_cells(sketch, places, (photons, scale.share, least), frame, bound, listed)
    for first in range(0, found, BLOCK):
        block = min(BLOCK, found - first)
        for c in range(2 * m):
            for x in range(BLOCK):
                z[c * BLOCK + x] = sketch[c, listed[first + x]] if x < block else ZERO
        peaks(z, steering, period, scratch, place, height)
        for x in range(block):
            j = places[listed[first + x]]
            cell = photons[j], scale.share, max(light[j], EPSILON)
            score = _score(height[x], place[x] - period * np.floor(place[x] / period), cell, frame)
            enough = scale.enough if is_flat else least[j]
            if is_flat:
                flat[j] = score
            for a in range(i * step, min((i + 1) * step, rows)):
                for b in range(j * step, min((j + 1) * step, cols)):
                    if not wanted[a, b]:
                        continue
                    point = state[a + MARGIN, layer, :, b + MARGIN]
                    if warm and _stays((z, x), score, cell, scale.confirmed,
                                       carried[a + MARGIN, layer, :, b + MARGIN], frame, point):
                        continue
                    known = point[SCORE] if point[INTENSITY] > ZERO else ZERO
                    if score > max(enough, known):
                        right = F32(b - j * step) - HALF * F32(step - 1)
                        down = F32(a - i * step) - HALF * F32(step - 1)
                        t = place[x] + slope_col * right + slope_row * down
                        _measure(t - period * np.floor(t / period), slopes, height[x] / frame.total_energy, score, cell,
                                 frame, point)


@line
def _search_slanted(i, places, row, inputs):
    """Search row i with windows along planes that rise or fall to the right, downwards or both."""
    frame, scale, steering = inputs
    (m, reach, _), width = scale.turns.shape, scale.pools.shape[2]
    lines = np.zeros((SLANTS, 2 * m, width + 2 * reach), np.float32)
    pools, sums = np.empty((SLANTS, 2 * m, width), np.float32), np.empty((8, width), np.float32)
    near = np.empty((4, width), np.float32)
    pool_down(i, scale.cells, scale.turns, sums, lines)
    for down in range(SLANTS):
        pool_across(lines[down], scale.turns, places, near, sums, pools)
        for right in range(SLANTS):
            if down != SLANTS // 2 or right != SLANTS // 2:
                slopes = F32(right - SLANTS // 2) * scale.rise, F32(down - SLANTS // 2) * scale.rise
                _search_row(i, pools[right], slopes, places, row, inputs)


@parallel
def _search(frame: Frame, scale: Scale, steering: Steering):
    m, width = len(frame.energy), scale.pools.shape[2]
    for i in prange(len(scale.pools)):
        places, least, flat = np.empty(width, np.int64), np.empty(width, np.float32), np.zeros(width, np.float32)
        asked = _ask(i, scale, ZERO, places)
        if asked == 0:
            continue
        row = Row(least, flat, np.empty(width, np.float32), np.empty(width, np.int64), aligned(2 * m * BLOCK),
                  (aligned(BLOCK), aligned(BLOCK)), peaks_scratch(steering.cells))
        sketch = np.empty((2 * m, width), np.float32)
        for c in range(2 * m):
            for x in range(asked):
                sketch[c, x] = scale.pools[i, c, places[x]]
        least[:] = min(scale.enough, scale.confirmed) if len(scale.carried) > 0 else scale.enough
        if len(scale.turns) > 0:
            least[:] = min(scale.enough, SEEN)
        inputs = frame, scale, steering
        _search_row(i, sketch, (ZERO, ZERO), places[:asked], row, inputs)
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
            _search_slanted(i, places[:doubtful], row, inputs)


def no_surfaces(frame, surfaces):
    return borrow("state", maps.state_shape(*frame.shape, surfaces), True)


def search(frame, matched, state, layer, sigma, step, enough, carried=None, confirmed=0.0, slanted=False):
    wanted = (maps.crop(frame.exposure, *frame.shape) > 0) & (maps.crop(state, *frame.shape)[:, layer, INTENSITY] == 0)
    if layer > 0:
        wanted &= maps.crop(state, *frame.shape)[:, layer - 1, INTENSITY] > 0
    if not wanted.any():
        return
    weights = maps.window_weights(sigma / step) if sigma > 0 else np.ones(1, np.float32)
    cells, pools = pool(frame, matched, wanted, weights, step)
    rise = SLANT * frame.resolution_bins / sigma if slanted else 0.0
    turns = turns_of(weights, frame.bin_frequencies * (step * rise)) if slanted else np.empty((0, 1, 3), np.float32)
    carried = np.empty((0, 0, 0, 0), np.float32) if carried is None else carried
    scale = Scale(cells, pools, wanted, state, carried, turns, F32(rise), layer, step, HALF if sigma > 0 else ONE,
                  F32(enough), F32(confirmed))
    _search(frame, scale, steering(frame.bin_frequencies, frame.num_bins))
