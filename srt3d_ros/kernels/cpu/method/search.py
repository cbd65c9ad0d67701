"""One scale of the start: `search` gives open pixels the surface that the window around them shows.

Windows of cells of pixels, z̄ = Σ w z, N = Σ w² n and G = Σ w g, are matched: t and S are depth and signal of the
highest peak. With q = Σ w² / Σ w and p = N / q,

    score = p / √N · ρ(S E / p) / c(t),    r = S / G,    std = √(q (S M₁ + (p − S)₊ M₀)) / (S C).

Since S E ≤ Σ_l |z̄_l|, most cells that cannot reach the score they need are found without a filter (`_may_reach`).
The others are matched (`_match_cells`), along the flat window first, then along slanted ones (`_search_slanted`). The
pixels of a cell take its best surface (`_give_row`).
"""

from typing import NamedTuple

import numpy as np
from numba import float32, get_thread_id, int32, int64

from srt3d_ros.kernels.constants import EPSILON, SEEN_SCORE, SLANT, SLANTED_SCORE, STEEPER, SURE_SCORE
from srt3d_ros.kernels.cpu.arithmetic import F32
from srt3d_ros.kernels.cpu.compiling import each, floats1d, floats2d, floats3d, floats4d, inline, line
from srt3d_ros.kernels.cpu.method.frame import Frame, Point
from srt3d_ros.kernels.cpu.method.likelihood import evidence, noise_at
from srt3d_ros.kernels.cpu.method.match import Steering, peaks, steering
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
from srt3d_ros.kernels.cpu.spans import ALL, columns, first_of, span
from srt3d_ros.kernels.cpu.vectors import floor, full, lane_numbers, lanes_of, sqrt, to_floats, to_ints, where
from srt3d_ros.kernels.maps import INTENSITY, LANES, MARGIN, SCORE, padded_shape, window_weights

NO_WINDOW, NO_TURNS = np.ones(1, np.float32), np.empty((0, 1, 3), np.float32)
ROOT_STEEPER = STEEPER**0.5


class Scale(NamedTuple):
    """What one scale of the start searches, and which scores it needs."""

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
    """Memory of each thread for a row of cells, [threads, …]."""

    least: floats2d             # [cols'], score that a cell needs; NEVER where it is not asked
    flat: floats2d              # [cols'], score of a cell's flat window
    best: floats3d              # [SCORE + 1, cols'], the point of a cell
    pooled: floats3d            # [2m + 2, cols'], windows: sketches, N and G
    total: floats4d             # [1, 1, cols'] of `blur_row`
    planes: floats4d            # [2 · SLANTS, 2m, cols'], sums downwards, and windows of these
    filter: floats3d            # [2m + cells + 1, LANES], z and responses of LANES cells
    listed: int32[:, ::1]       # [cols'], columns of the cells that may reach the score they need


@inline
def _may_reach(need, response, photons, scale, frame):
    """Whether windows reach the score they need if the filter responds so much."""
    return evidence(response, photons / scale.share, photons, frame) > need


@line
def _list_cells(sketch, counts, scale, frame, least, listed):
    """List the cells of a row that may reach the score they need; returns how many. The last one fills a vector."""
    found, m = 0, len(frame.energy)
    for col in columns(least):
        need = least[col]
        if lanes_of(need < NEVER) == 0:
            continue
        bound = full(0.0)
        for l in range(m):
            bound += size(sketch[l, col], sketch[m + l, col])
        lanes = lanes_of(_may_reach(need, bound, counts[col], scale, frame))
        for x in range(LANES):
            listed[found] = first_of(col) + x
            found += (lanes >> x) & 1
    if found > 0:
        listed[span(found)] = listed[found - 1]
    return found


@inline
def _measure(depth, slopes, response, photons, light, scale, frame):
    """The surfaces that windows of so many photons and so much light show, of which the filter responds so much."""
    share, (slope_col, slope_row), period = scale.share, slopes, frame.period
    depth -= period * floor(depth / period)
    score = evidence(response, photons / share, photons, frame) / noise_at(frame, depth)
    signal = response / frame.total_energy
    by_signal = max(signal, EPSILON)
    by_background = max(photons / share - by_signal, 0)
    spread = share * (by_signal * frame.moments[0] + by_background * frame.moments[1])
    std = min(sqrt(spread) / (by_signal * frame.curvature), period)
    return Point(depth, full(slope_col), full(slope_row), signal / max(light, EPSILON), std, score, full(0.0))


@line
def _match_cells(windows, slopes, enough, scale, steering, frame, memory):
    """Match a row of windows, and keep the surfaces with more than the score needed, and `enough`."""
    (sketch, counts, exposure), m, own = windows, len(frame.energy), get_thread_id()
    least, flat, best, listed = memory.least[own], memory.flat[own], memory.best[own], memory.listed[own]
    z, response = memory.filter[own, :2 * m], memory.filter[own, 2 * m:]
    for first in range(0, _list_cells(sketch, counts, scale, frame, least, listed), LANES):
        at = listed[span(first)]
        for n in range(m):
            z[n, ALL], z[m + n, ALL] = sketch[steering.order[n], at], sketch[m + steering.order[n], at]
        place, height = peaks(z, steering, frame.period, response)
        found = _measure(place, slopes, height, counts[at], exposure[at], scale, frame)
        flat[at] = found.score
        need = least[at]
        taken = found.score > max(need, enough)
        if lanes_of(taken) != 0:
            least[at] = where(taken, found.score, need)
            for field in range(SCORE + 1):
                best[field, at] = where(taken, found[field], best[field, at])


@line
def _doubt(scale, least, flats):
    """Ask for a slanted window where a flat one shows a surface, but not surely; whether there is such a cell."""
    lanes = 0
    for col in columns(least):
        flat = flats[col]
        doubtful = (flat > SEEN_SCORE) & ((flat < SURE_SCORE) | (flat <= scale.enough))
        least[col] = where(doubtful, max(flat * ROOT_STEEPER, SLANTED_SCORE), NEVER)
        lanes |= lanes_of(doubtful)
    return lanes != 0


@line
def _search_slanted(row, cells, counts, exposure, scale, steering, frame, memory):
    """Search a row with windows along planes that rise or fall to the right, downwards or both.

    In nearly all cells no slanted window can reach the score they need: they are asked no longer.
    """
    own = get_thread_id()
    least, lines, planes = memory.least[own], memory.planes[own, :SLANTS], memory.planes[own, SLANTS:]
    pool_along(DOWN, cells.z, row, scale.turns, least, lines)
    for col in columns(least):
        need = least[col]
        if lanes_of(need < NEVER) != 0:
            bound = bound_across(lines, col, scale.turns)
            least[col] = where(_may_reach(need, bound, counts[col], scale, frame), need, NEVER)
    for down in range(SLANTS):
        pool_along(RIGHT, lines, down, scale.turns, least, planes)
        for right in range(SLANTS):
            if down != SLANTS // 2 or right != SLANTS // 2:
                slopes = F32(right - SLANTS // 2) * scale.rise, F32(down - SLANTS // 2) * scale.rise
                _match_cells((planes[right], counts, exposure), slopes, 0, scale, steering, frame, memory)


@line
def _give_row(i, down, scale, wanted, best, period, state):
    """Give a row's open pixels their cell's surface, moved along its plane."""
    layer, step, middle = scale.layer, scale.step, 0.5 * (scale.step - 1)
    for j in columns(state):
        is_open = wanted[i, 0, j] > 0
        if lanes_of(is_open):
            x = to_floats(lane_numbers() + (first_of(j) - MARGIN))
            cell = floor((x + 0.5) / step)
            at = to_ints(cell, full(F32(state.shape[3]))) + MARGIN
            taken = is_open & (best[SCORE, at] > 0)
            if lanes_of(taken):
                depth, slope_col, slope_row = best[0, at], best[1, at], best[2, at]
                depth += slope_col * (x - cell * step - middle) + slope_row * (down - middle)
                for field in range(SCORE + 1):
                    new = best[field, at] if field > 0 else depth - period * floor(depth / period)
                    state[i, layer, field, j] = where(taken, new, state[i, layer, field, j])


def _open(i, j, scale: Scale, pixels: Cells, state: floats4d):
    """Write 1 where a used pixel has `layer` surfaces, else 0."""
    is_open = (pixels.exposure[i, 0, j] > 0) & (state[i, scale.layer, INTENSITY, j] == 0)
    if scale.layer > 0:
        is_open &= state[i, scale.layer - 1, INTENSITY, j] > 0
    pixels.wanted[i, 0, j] = where(is_open, 1, 0)


def _bin(row, scale: Scale, pixels: Cells, cells: Cells, memory: Memory, wanted: floats3d):
    if len(scale.weights) > 1:
        bin_row(row, scale.step, pixels, cells, memory.flat[get_thread_id()])


def _search_row(row, frame: Frame, scale: Scale, steering: Steering, pixels: Cells, state: floats4d, cells: Cells,
                memory: Memory, wanted: floats3d):
    any_open, own = full(False), get_thread_id()
    least, flat, best = memory.least[own], memory.flat[own], memory.best[own]
    flat[:], best[SCORE, :] = 0, 0
    for col in columns(least):
        is_open = wanted[row, 0, col] > 0
        least[col] = where(is_open, scale.asked, NEVER)
        any_open |= is_open
    if lanes_of(any_open) == 0:
        return
    sketch, counts, exposure = cells.z[row], cells.counts[row, 0], cells.exposure[row, 0]
    if len(scale.weights) > 1:
        pooled, total, last = memory.pooled[own], memory.total[own], len(sketch)
        sketch, counts, exposure = pooled[:last], pooled[last], pooled[last + 1]
        blur_row(cells.z, row, scale.weights, least, total, sketch)
        blur_row(cells.counts, row, scale.squares, least, total, pooled[last:])
        blur_row(cells.exposure, row, scale.weights, least, total, pooled[last + 1:])
    flat_slopes = F32(0), F32(0)
    _match_cells((sketch, counts, exposure), flat_slopes, scale.enough, scale, steering, frame, memory)
    if len(scale.turns) > 0 and _doubt(scale, least, flat):
        _search_slanted(row, cells, counts, exposure, scale, steering, frame, memory)
    first = (row - MARGIN) * scale.step + MARGIN
    for down in range(scale.step):
        _give_row(first + down, down, scale, pixels.wanted, best, frame.period, state)


_search = each(_open, _bin, _search_row)


def no_surfaces(work, frame, surfaces):
    state = work.other_state()
    state[:] = 0
    return state


def search(work, frame, matched, state, layer, sigma, step, enough, slanted=False):
    frame, threads = Frame.of(frame), work.threads
    (rows, cols), channels, filters = work.shape, matched.shape[1], steering(work.frequencies)
    high, wide = padded_shape(-(-rows // step), -(-cols // step))
    cells = pixels = Cells(matched, *(values[:, None] for values in (frame.counts, frame.exposure, work.map("wanted"))))
    weights, share, rise, turns, asked = NO_WINDOW, 1.0, 0.0, NO_TURNS, enough
    if sigma > 0:
        weights, share = window_weights(sigma / step), 0.5
        cells = Cells(*(work.array(name, high, size, wide) for name, size in (
            ("z", channels), ("counts", 1), ("exposure", 1), ("wanted cells", 1))))
    if slanted:
        rise, asked = SLANT * frame.resolution / sigma, min(enough, SEEN_SCORE)
        turns = turns_of(weights, frame.bin_frequencies * (step * rise))
    memory = Memory(work.array("least", threads, wide), work.array("flat", threads, wide),
                    work.array("best", threads, SCORE + 1, wide),
                    work.array("pooled", threads, channels + 2, wide), work.array("total", threads, 1, 1, wide),
                    work.array("planes", threads, 2 * SLANTS, channels, wide),
                    work.array("filter", threads, channels + filters.cells + 1, LANES),
                    work.array("listed", threads, wide, of=np.int32))
    scale = Scale(weights, weights**2, turns, F32(rise), layer, step, F32(share), F32(asked), F32(enough))
    _search(scale, pixels, state, cells, memory, cells.wanted, frame, filters)
