"""One scale of the start: pool the sketches of open pixels, match them, and give sure pools' pixels their surface.

Two launches a scale: one pools rows, the other columns, in registers, where pools are matched at once. A window over
cells is one over pixels, whose weights are the same all over a cell. Closed pixels are not read, and cells without an
open pixel not looked at: a scale after the one that settles most pixels reads the 8m bytes of the few that are left.
"""

import numpy as np
import torch
import triton
import triton.language as tl

from srt3d_ros.kernels import constants, maps
from srt3d_ros.kernels.cuda.arithmetic import EPSILON, axis, sincos, wrap
from srt3d_ros.kernels.cuda.device import borrow, constant
from srt3d_ros.kernels.cuda.likelihood import surprise
from srt3d_ros.kernels.cuda.maps import (
    DEPTH,
    FIELDS,
    INTENSITY,
    MARGIN,
    SCORE,
    SLOPE_COL,
    SLOPE_ROW,
    record_of,
    store_surface,
)
from srt3d_ros.kernels.cuda.match import CELLS, PIXELS, peak
from srt3d_ros.kernels.cuda.prepare import phases

FAINTEST, STAY, DOUBTFUL = (tl.constexpr(getattr(constants, name)) for name in ("FAINTEST", "STAY", "DOUBTFUL"))
COLS, CHANNELS = 32, 16         # columns and channels whose rows one program pools


@triton.jit
def _is_open(exposure, state, i, j, inside, padded_cols, LAYER: tl.constexpr, SURFACES: tl.constexpr):
    """Whether pixels (i, j) of the image are used, have no surface LAYER, but one before it."""
    pixel = (i + MARGIN) * padded_cols + j + MARGIN
    found = state + (((i + MARGIN) * SURFACES + LAYER) * FIELDS + INTENSITY) * padded_cols + j + MARGIN
    lit = tl.load(exposure + pixel, mask=inside, other=0.0) > 0.0
    is_open = inside & lit & (tl.load(found, mask=inside, other=1.0) == 0.0)
    if LAYER > 0:
        is_open = is_open & (tl.load(found - FIELDS * padded_cols, mask=inside, other=0.0) > 0.0)
    return is_open


@triton.jit
def _rival(state, i, j, inside, padded_cols, LAYER: tl.constexpr, SURFACES: tl.constexpr):
    """Scores of the surfaces LAYER of pixels (i, j), −∞ where there is none."""
    record = record_of(state, i + MARGIN, LAYER, j + MARGIN, padded_cols, SURFACES)
    found = tl.load(record + INTENSITY * padded_cols, mask=inside, other=0.0) > 0.0
    return tl.where(found, tl.load(record + SCORE * padded_cols, mask=inside, other=0.0), float("-inf"))


@triton.jit
def _pool_rows(matched, counts, exposure, state, weights, rows, cols, padded_cols, channels, out, LAYER: tl.constexpr,
               SURFACES: tl.constexpr, STEP: tl.constexpr, TAPS: tl.constexpr, COLS: tl.constexpr,
               CHANNELS: tl.constexpr):
    """Sums over rows of what open pixels show: channels of the sketch, then exposure, then noise, weights squared."""
    j, c = tl.program_id(0) * COLS + tl.arange(0, COLS), tl.program_id(1) * CHANNELS + tl.arange(0, CHANNELS)[:, None]
    first = (tl.program_id(2) - TAPS // 2) * STEP
    total = tl.zeros([CHANNELS, COLS], tl.float32)
    light, photons = tl.zeros([COLS], tl.float32), tl.zeros([COLS], tl.float32)
    for tap in tl.range(TAPS * STEP, loop_unroll_factor=4):
        i, weight = first + tap, tl.load(weights + tap // STEP)
        pixel = (i + MARGIN) * padded_cols + j + MARGIN
        inside = j < tl.where((i >= 0) & (i < rows), cols, 0)
        seen = _is_open(exposure, state, i, j, inside, padded_cols, LAYER, SURFACES)
        source = matched + ((i + MARGIN) * channels + c) * padded_cols + (j + MARGIN)[None, :]
        total += weight * tl.load(source, mask=seen[None, :] & (c < channels), other=0.0)
        light += weight * tl.load(exposure + pixel, mask=seen, other=0.0)
        photons += weight * weight * tl.load(counts + pixel, mask=seen, other=0.0)
    into, inside = out + tl.program_id(2) * (channels + 2) * cols + j, j < cols
    tl.store(into[None, :] + c * cols, total, mask=inside[None, :] & (c < channels))
    inside = j < tl.where(tl.program_id(1) == 0, cols, 0)
    tl.store(into + channels * cols, light, mask=inside)
    tl.store(into + (channels + 1) * cols, photons, mask=inside)


@triton.jit
def _score(signal, counts, share, total, max_response, background_table, STEPS: tl.constexpr):
    """Evidence of a matched filter against "background alone", as `_score` in kernels/cpu/search.py."""
    photons = tl.maximum(counts / share, EPSILON)
    rare = surprise(signal * total, photons, max_response, background_table, STEPS)
    return tl.sqrt(photons / share) * rare


@triton.jit
def _rarer(score, depth, clutter, BINS: tl.constexpr):
    """The score in standard deviations of the background at this depth; BINS of `clutter`, 0 for none."""
    if BINS > 0:
        score = score / tl.load(clutter + tl.floor(depth + 0.5).to(tl.int32) % BINS)
    return score


@triton.jit
def _std(signal, counts, share, moments, curvature, period):
    """Standard deviation of a depth found in a window, bins; arguments as of `_score`."""
    signal = tl.maximum(signal, EPSILON)
    background = tl.maximum(counts / share - signal, 0.0)
    spread = share * (signal * tl.load(moments) + background * tl.load(moments + 1))
    return tl.minimum(tl.sqrt(spread) / (signal * curvature), period)


@triton.jit
def _is_new(first, depth, intensity, apart, period, new, padded_cols, LAYER: tl.constexpr):
    """Which of the surfaces `new` stand beside those from `first` on of their pixels: resolved, and not too faint."""
    if LAYER > 0:
        new = new & (intensity > tl.load(first + INTENSITY * padded_cols, mask=new, other=0.0) * FAINTEST)
    for k in tl.static_range(LAYER):
        known = first + k * FIELDS * padded_cols
        e = wrap(tl.load(known + DEPTH * padded_cols, mask=new, other=0.0) - depth, period)
        there = tl.load(known + INTENSITY * padded_cols, mask=new, other=0.0) > 0.0
        new = new & ~((tl.abs(e) <= apart) & there)
    return new


@triton.jit
def _pool_cols(matched, counts, light, line, across, line_of_one, weights, row, cell, cols, m, STEP: tl.constexpr,
               TAPS: tl.constexpr, M: tl.constexpr, PIXELS: tl.constexpr):
    """Sums over columns: of the sketch, its real and its imaginary parts; of exposure, and of noise.

    Args:
        matched, counts, light: pools of rows, or the maps themselves.
        line, across, line_of_one: from a row, and a channel, of `matched` to the next; from one of the others.
        row, cell: of the cells.
    """
    l = tl.arange(0, M)
    re, im = tl.zeros([M, PIXELS], tl.float32), tl.zeros([M, PIXELS], tl.float32)
    photons, lit = tl.zeros([PIXELS], tl.float32), tl.zeros([PIXELS], tl.float32)
    for tap in tl.range(TAPS * STEP, loop_unroll_factor=4):
        j, weight = (cell - TAPS // 2) * STEP + tap, tl.load(weights + tap // STEP)
        inside = (j >= 0) & (j < cols)
        at, known = matched + row * line + l[:, None] * across + j[None, :], (l < m)[:, None] & inside[None, :]
        re += weight * tl.load(at, mask=known, other=0.0)
        im += weight * tl.load(at + m * across, mask=known, other=0.0)
        lit += weight * tl.load(light + row * line_of_one + j, mask=inside, other=0.0)
        photons += weight * weight * tl.load(counts + row * line_of_one + j, mask=inside, other=0.0)
    return re, im, lit, photons


@triton.jit
def _decide(matched, counts, light, line, across, line_of_one, exposure, before, state, carried, weights, share,
            enough, confirmed, slope_col, slope_row, first_row, first_cell, bin_frequencies, total, curvature, apart,
            max_response, background_table, moments, clutter, period, rows, cols, padded_cols, m, WARM: tl.constexpr,
            LAYER: tl.constexpr, SURFACES: tl.constexpr, STEP: tl.constexpr, TAPS: tl.constexpr, STEPS: tl.constexpr,
            BINS: tl.constexpr, M: tl.constexpr, PIXELS: tl.constexpr, CELLS: tl.constexpr):
    """Pool the columns of PIXELS cells of a row, match the pools, and write the surfaces of those that are sure.

    Args:
        matched, counts, light, line, across, line_of_one: as of `_pool_cols`.
        before: the state that tells which pixels are open.
        WARM: whether there are carried surfaces.
        first_row, first_cell: of cells, in the whole array.
        BINS: of `clutter`; 0 for none.
    """
    row, cell, l = tl.program_id(1), tl.program_id(0) * PIXELS + tl.arange(0, PIXELS), tl.arange(0, M)
    some = tl.zeros([PIXELS], tl.int32)
    for own in tl.range(STEP * STEP, loop_unroll_factor=4):
        i, j = row * STEP + own // STEP, cell * STEP + own % STEP
        inside = j < tl.where(i < rows, cols, 0)
        wanted = _is_open(exposure, before, i, j, inside, padded_cols, LAYER, SURFACES)
        some |= (wanted & (_rival(state, i, j, inside, padded_cols, LAYER, SURFACES) < DOUBTFUL)).to(tl.int32)
    if tl.max(some, axis=0) == 0:
        return

    re, im, lit, photons = _pool_cols(matched, counts, light, line, across, line_of_one, weights, row, cell, cols, m,
                                      STEP, TAPS, M, PIXELS)
    frequency = tl.load(bin_frequencies + l, mask=l < m, other=0.0)
    depth, height = peak(re, im, tl.floor(frequency * period + 0.5), period, CELLS)
    depth += STEP * (slope_col * (first_cell + cell).to(tl.float32) + slope_row * (first_row + row).to(tl.float32))
    depth, signal = depth - period * tl.floor(depth / period), height / total
    score = _score(signal, photons, share, total, max_response, background_table, STEPS)
    score = _rarer(score, depth, clutter, BINS)
    light_of = tl.maximum(lit, EPSILON)
    std = _std(signal, photons, share, moments, curvature, period)
    for own in range(STEP * STEP):
        i, j = row * STEP + own // STEP, cell * STEP + own % STEP
        inside = j < tl.where(i < rows, cols, 0)
        room = _is_open(exposure, before, i, j, inside, padded_cols, LAYER, SURFACES)
        rival = _rival(state, i, j, inside, padded_cols, LAYER, SURFACES)
        room = room & (rival < DOUBTFUL)
        first = record_of(state, i + MARGIN, 0, j + MARGIN, padded_cols, SURFACES)
        new = _is_new(first, depth, signal / light_of, apart, period, room & (score > tl.maximum(rival, enough)),
                      padded_cols, LAYER)
        into = first + LAYER * FIELDS * padded_cols
        if WARM:
            old = record_of(carried, i + MARGIN, LAYER, j + MARGIN, padded_cols, SURFACES)
            stays = room & (tl.load(old + INTENSITY * padded_cols, mask=room, other=0.0) > 0.0)
            was = tl.load(old + DEPTH * padded_cols, mask=stays, other=0.0)
            sine, cosine = sincos(frequency[:, None] * was[None, :])
            shown = tl.sum(re * cosine + im * sine, axis=0) / total
            known = _score(shown, photons, share, total, max_response, background_table, STEPS)
            known = _rarer(known, was, clutter, BINS)
            stays = stays & (known > confirmed) & (score * score - known * known < 2.0 * STAY)
            new = new & ~stays
            plane = (was, tl.load(old + SLOPE_COL * padded_cols, mask=stays, other=0.0),
                     tl.load(old + SLOPE_ROW * padded_cols, mask=stays, other=0.0))
            old_std = _std(shown, photons, share, moments, curvature, period)
            tl.debug_barrier()
            store_surface(into, plane, shown / light_of, old_std, known, stays, padded_cols)
        tl.debug_barrier()      # threads that share a pixel have all seen it open
        there = depth + slope_col * (own % STEP) + slope_row * (own // STEP)
        there -= period * tl.floor(there / period)
        store_surface(into, (there, slope_col, slope_row), signal / light_of, std, score, new, padded_cols)


def _sheared(frame, matched, slope):
    """The map with a plane of this slope turned to depth 0."""
    rows, _, cols = matched.shape
    down, right = (torch.arange(pixels, device=matched.device) + (first - MARGIN.value)
                   for pixels, first in zip((rows, cols), frame.origin))
    cosine, sine = phases(frame, slope[0] * right + slope[1] * down[:, None])
    re, im = matched.chunk(2, dim=1)
    return torch.cat([re * cosine + im * sine, im * cosine - re * sine], dim=1)


def search(frame, matched, state, layer, sigma, step, enough, scratch=None, carried=None, confirmed=0.0,
           slope=(0.0, 0.0), before=None):
    before = state if before is None else before
    if slope != (0.0, 0.0):
        matched = _sheared(frame, matched, slope)
    (rows, cols), channels, padded_cols, surfaces = frame.shape, matched.shape[1], matched.shape[2], state.shape[1]
    high, m = triton.cdiv(rows, step), channels // 2
    weights = maps.window_weights(sigma / step) if sigma > 0 else np.ones(1)
    weights, sizes = constant(weights), {"LAYER": layer, "SURFACES": surfaces, "STEP": step, "TAPS": len(weights)}
    if sigma > 0:
        pools = borrow(scratch, "pools", (high, channels + 2, cols))
        _pool_rows[(triton.cdiv(cols, COLS), triton.cdiv(channels, CHANNELS), high)](
            matched, frame.counts, frame.exposure, before, weights, rows, cols, padded_cols, channels, pools, **sizes,
            COLS=COLS, CHANNELS=CHANNELS)
        pooled = pools, pools[:, channels + 1], pools[:, channels]
        lines, share = ((channels + 2) * cols, cols, (channels + 2) * cols), 0.5
    else:
        pooled = (values[maps.MARGIN:, ..., maps.MARGIN:] for values in (matched, frame.counts, frame.exposure))
        lines, share = (channels * padded_cols, padded_cols, padded_cols), 1.0
    clutter, bins = (frame.counts, 0) if frame.clutter is None else (frame.clutter, len(frame.clutter))
    _decide[(triton.cdiv(triton.cdiv(cols, step), PIXELS), high)](
        *pooled, *lines, frame.exposure, before, state, state if carried is None else carried, weights, share, enough,
        confirmed, *slope, *(first // step for first in frame.origin), frame.bin_frequencies, frame.total_energy,
        frame.curvature, constants.APART * frame.resolution_bins, frame.max_response, frame.background_table,
        frame.moments, clutter, float(frame.num_bins), rows, cols, padded_cols, m, WARM=carried is not None, **sizes,
        STEPS=len(frame.background_table) - 1, BINS=bins,
        M=max(axis(m), 16), PIXELS=PIXELS, CELLS=CELLS, num_warps=4)


def drop_weak(state, weak):
    state[:, :, maps.INTENSITY].masked_fill_(state[:, :, maps.SCORE] < weak, 0.0)
