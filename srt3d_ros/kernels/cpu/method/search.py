"""One scale of the start: `search` gives open pixels the surface that the window around them shows.

Windows of cells of pixels, z̄ = Σ w z, N = Σ w² n and G = Σ w g, are matched: t and S are depth and signal of the
highest peak. With q = Σ w² / Σ w and p = N / q,

    score = p / √N · ρ(S E / p) / c(t),    r = S / G,    std = √(q (S M₁ + (p − S)₊ M₀)) / (S C).

Since S E ≤ Σ_l |z̄_l|, most cells that cannot reach the score they need are found without a filter (`_may_reach`).
The others are matched (`_match_cells`), along the flat window first, then along slanted ones (`_search_slanted`). The
pixels of a cell take its best surface (`_write_pixels`).
"""

from typing import NamedTuple

import numpy as np
from numba import float32, get_thread_id, int32, int64, prange

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import SEEN_SCORE, SLANT, SLANTED_SCORE, STEEPER, SURE_SCORE
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, HALF, ONE, ZERO
from srt3d_ros.kernels.cpu.compiling import floats1d, floats2d, floats3d, floats4d, inline, line, parallel
from srt3d_ros.kernels.cpu.method.frame import Frame, Point, columns
from srt3d_ros.kernels.cpu.method.likelihood import evidence, noise_at
from srt3d_ros.kernels.cpu.method.match import Steering, peaks
from srt3d_ros.kernels.cpu.method.windows import (
    DOWN,
    NEVER,
    RIGHT,
    SLANTS,
    Cells,
    bin_row,
    blur_row,
    bound_across,
    pool_along,
    size,
    turns_of,
)
from srt3d_ros.kernels.cpu.vectors import (
    floor,
    full,
    lane_numbers,
    lanes_of,
    load,
    sqrt,
    store,
    to_cell,
    to_floats,
    where,
)
from srt3d_ros.kernels.maps import INTENSITY, LANES, MARGIN, SCORE

NO_WINDOW, NO_TURNS = np.ones(1, np.float32), np.empty((0, 1, 3), np.float32)
SEEN, SURE, SLANTED, ROOT_STEEPER = F32(SEEN_SCORE), F32(SURE_SCORE), F32(SLANTED_SCORE), F32(STEEPER**0.5)


class Scale(NamedTuple):
    """What one scale of the start searches, and which scores it needs."""

    state: floats4d
    weights: floats1d           # of a window's rows and columns of cells
    squares: floats1d
    turns: floats3d             # [m, reach, 3] of `turns_of`; [0, …] without slanted windows
    rise: float32               # slope of slanted windows, bins per pixel
    layer: int64                # index of the surface
    step: int64                 # pixels along the side of a cell
    share: float32              # q
    asked: float32              # score below which a flat window is of no use
    enough: float32             # score that a new surface needs


class Memory(NamedTuple):
    """Memory for a row of cells; in `_search`, of each thread."""

    z: floats3d                 # [2m, cols'], windows: sketches
    counts: floats3d            # [1, cols'], N
    exposure: floats3d          # G
    total: floats2d             # [cols'] of `blur_row`
    least: floats2d             # [cols'], score that a cell needs; NEVER where it is not asked
    flat: floats2d              # [cols'], score of a cell's flat window
    best: floats3d              # [SCORE + 1, cols'], the point of a cell
    planes: floats4d            # [2 · SLANTS, 2m, cols'], sums downwards, and windows of these
    filter: floats3d            # [2m + cells + 1, LANES], z and responses of LANES cells
    listed: int32[:, ::1]       # [cols'], columns of the cells that may reach the score they need


@inline
def _may_reach(need, response, photons, scale, frame):
    """Whether windows reach the score they need if the filter responds so much."""
    return evidence(response, photons / scale.share, photons, frame) > need


@line
def _list_cells(sketch, counts, scale, frame, memory):
    """List the cells of a row that may reach the score they need; returns how many. The last one fills a vector."""
    found, m, least, listed = 0, len(frame.energy), memory.least, memory.listed
    for col in columns(least):
        need = load(least, col)
        if lanes_of(need < NEVER) == 0:
            continue
        bound = full(ZERO)
        for l in range(m):
            bound += size(load(sketch, l, col), load(sketch, m + l, col))
        lanes = lanes_of(_may_reach(need, bound, load(counts, 0, col), scale, frame))
        for x in range(LANES):
            listed[found] = col + x
            found += (lanes >> x) & 1
    if found > 0:
        store(listed, found, listed[found - 1])
    return found


@inline
def _measure(depth, slopes, response, photons, light, scale, frame):
    """The surfaces that windows of so many photons and so much light show, of which the filter responds so much."""
    share, (slope_col, slope_row), period = scale.share, slopes, frame.period
    depth -= period * floor(depth / period)
    score = evidence(response, photons / share, photons, frame) / noise_at(frame, depth)
    signal = response / frame.total_energy
    by_signal = max(signal, EPSILON)
    by_background = max(photons / share - by_signal, ZERO)
    spread = share * (by_signal * frame.moments[0] + by_background * frame.moments[1])
    std = min(sqrt(spread) / (by_signal * frame.curvature), period)
    return Point(depth, slope_col, slope_row, signal / max(light, EPSILON), std, score, full(ZERO))


@line
def _match_cells(sketch, window, slopes, enough, scale, steering, frame, memory):
    """Match a row of windows [2m, cols'], and keep the surfaces with more than the score needed, and `enough`."""
    (counts, exposure), (least, flat, best, listed) = window, (memory.least, memory.flat, memory.best, memory.listed)
    m, (slope_col, slope_row) = len(frame.energy), slopes
    z, response = memory.filter[:2 * m], memory.filter[2 * m:]
    for first in range(0, _list_cells(sketch, counts, scale, frame, memory), LANES):
        at = load(listed, first)
        for n in range(m):
            store(z, n, 0, load(sketch, steering.order[n], at))
            store(z, m + n, 0, load(sketch, m + steering.order[n], at))
        place, height = peaks(z, steering, frame.period, response)
        found = _measure(place, (full(slope_col), full(slope_row)), height, load(counts, 0, at),
                         load(exposure, 0, at), scale, frame)
        store(flat, at, found.score)
        need = load(least, at)
        taken = found.score > max(need, enough)
        if lanes_of(taken) != 0:
            store(least, at, where(taken, found.score, need))
            for field in range(SCORE + 1):
                store(best, field, at, where(taken, found[field], load(best, field, at)))


@line
def _doubt(scale, memory):
    """Ask for a slanted window where a flat one shows a surface, but not surely; whether there is such a cell."""
    lanes, least = 0, memory.least
    for col in columns(least):
        flat = load(memory.flat, col)
        doubtful = (flat > SEEN) & ((flat < SURE) | (flat <= scale.enough))
        store(least, col, where(doubtful, max(flat * ROOT_STEEPER, SLANTED), NEVER))
        lanes |= lanes_of(doubtful)
    return lanes != 0


@line
def _rule_out(lines, counts, scale, frame, least):
    """Ask no longer for the cells in which no slanted window can reach the score they need: nearly all of them."""
    for col in columns(least):
        need = load(least, col)
        if lanes_of(need < NEVER) != 0:
            bound = bound_across(lines, col, scale.turns)
            store(least, col, where(_may_reach(need, bound, load(counts, 0, col), scale, frame), need, NEVER))


@line
def _search_slanted(row, cells, window, scale, steering, frame, memory):
    """Search a row with windows along planes that rise or fall to the right, downwards or both."""
    lines, planes = memory.planes[:SLANTS], memory.planes[SLANTS:]
    pool_along(DOWN, cells.z, row, scale.turns, memory.least, lines)
    _rule_out(lines, window[0], scale, frame, memory.least)
    for down in range(SLANTS):
        pool_along(RIGHT, lines, down, scale.turns, memory.least, planes)
        for right in range(SLANTS):
            if down != SLANTS // 2 or right != SLANTS // 2:
                slopes = F32(right - SLANTS // 2) * scale.rise, F32(down - SLANTS // 2) * scale.rise
                _match_cells(planes[right], window, slopes, ZERO, scale, steering, frame, memory)


@inline
def _shown(best, at, right, down, period):
    """The surfaces of cells in the columns `at`, moved along their planes to pixels so far from their middles."""
    depth, slope_col, slope_row = load(best, 0, at), load(best, 1, at), load(best, 2, at)
    depth += slope_col * right + slope_row * down
    return Point(depth - period * floor(depth / period), slope_col, slope_row, load(best, 3, at), load(best, 4, at),
                 load(best, 5, at), full(ZERO))


@line
def _write_pixels(row, wanted, scale, period, memory):
    """Give the open pixels in row `row` of cells their cell's surface, moved along its plane."""
    state, layer, step = scale.state, scale.layer, scale.step
    middle = HALF * F32(step - 1)
    for a in range(step):
        pixel_row = (row - MARGIN) * step + MARGIN + a
        for col in columns(state):
            is_open = load(wanted, pixel_row, 0, col) > ZERO
            if lanes_of(is_open) == 0:
                continue
            x = to_floats(lane_numbers() + (col - MARGIN))
            cell = floor((x + HALF) / F32(step))
            at = to_cell(cell, F32(state.shape[3])) + MARGIN
            new = _shown(memory.best, at, x - cell * F32(step) - middle, F32(a) - middle, period)
            taken = is_open & (new.score > ZERO)
            if lanes_of(taken) != 0:
                for field in range(SCORE + 1):
                    own = load(state, pixel_row, layer, field, col)
                    store(state, pixel_row, layer, field, col, where(taken, new[field], own))


@line
def _open_row(row, pixels, state, layer):
    """Write 1 where a used pixel has `layer` surfaces, else 0."""
    for col in range(0, pixels.wanted.shape[2], LANES):
        is_open = (load(pixels.exposure, row, 0, col) > ZERO) & (load(state, row, layer, INTENSITY, col) == ZERO)
        if layer > 0:
            is_open &= load(state, row, layer - 1, INTENSITY, col) > ZERO
        store(pixels.wanted, row, 0, col, where(is_open, ONE, ZERO))


@line
def _search_row(row, pixels, cells, scale, steering, frame, memory):
    least, any_open = memory.least, full(False)
    least[:], memory.flat[:] = NEVER, ZERO
    memory.best[SCORE, :] = ZERO
    for col in columns(least):
        is_open = load(cells.wanted, row, 0, col) > ZERO
        store(least, col, where(is_open, scale.asked, NEVER))
        any_open |= is_open
    if lanes_of(any_open) == 0:
        return
    sketch, window = cells.z[row], (cells.counts[row], cells.exposure[row])
    if len(scale.weights) > 1:
        sketch, window = memory.z, (memory.counts, memory.exposure)
        blur_row(cells.z, row, scale.weights, least, memory.total, sketch)
        blur_row(cells.counts, row, scale.squares, least, memory.total, window[0])
        blur_row(cells.exposure, row, scale.weights, least, memory.total, window[1])
    _match_cells(sketch, window, (ZERO, ZERO), scale.enough, scale, steering, frame, memory)
    if len(scale.turns) > 0 and _doubt(scale, memory):
        _search_slanted(row, cells, window, scale, steering, frame, memory)
    _write_pixels(row, pixels.wanted, scale, frame.period, memory)


@parallel
def _search(frame: Frame, pixels: Cells, cells: Cells, scale: Scale, steering: Steering, memory: Memory):
    rows = len(cells.z) - 2 * MARGIN        # known here, or numba takes the number from the branch below
    for row in prange(len(pixels.z)):
        _open_row(row, pixels, scale.state, scale.layer)
    if len(scale.weights) > 1:
        for turn in prange(rows):
            bin_row(turn + MARGIN, scale.step, pixels, cells, memory.flat[get_thread_id()])
    for turn in prange(rows):
        t = get_thread_id()
        _search_row(turn + MARGIN, pixels, cells, scale, steering, frame, Memory(
            memory.z[t], memory.counts[t], memory.exposure[t], memory.total[t], memory.least[t], memory.flat[t],
            memory.best[t], memory.planes[t], memory.filter[t], memory.listed[t]))


def no_surfaces(work, frame, surfaces):
    work.states[0][:] = 0
    return work.states[0]


def search(work, frame, matched, state, layer, sigma, step, enough, slanted=False):
    frame = Frame.of(frame)
    cells = pixels = Cells(matched, *(values[:, None] for values in (frame.counts, frame.exposure, work.wanted)))
    weights, share, rise, turns, asked = NO_WINDOW, 1.0, 0.0, NO_TURNS, enough
    if sigma > 0:
        weights, share, cells = maps.window_weights(sigma / step), 0.5, work.cells[step]
    if slanted:
        rise, asked = SLANT * frame.resolution / sigma, min(enough, SEEN)
        turns = turns_of(weights, frame.bin_frequencies * (step * rise))
    scale = Scale(state, weights, weights**2, turns, F32(rise), layer, step, F32(share), F32(asked),
                  F32(enough))
    _search(frame, pixels, cells, scale, work.steering, work.searches[step])
