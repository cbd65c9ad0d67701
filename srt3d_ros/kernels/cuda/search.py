"""One scale of the start: pool the sketches of open pixels, match them, and give sure pools' pixels their surface.

Two launches a scale: one pools rows, the other columns, in registers, where pools are matched at once. Closed pixels
are not read, and cells without an open pixel not looked at: a scale after the one that settles most pixels reads the
8m bytes of the few that are left.
"""

import triton
import triton.language as tl

from srt3d_ros.core import layout
from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cuda.arithmetic import axis, sincos, wrap
from srt3d_ros.kernels.cuda.layout import (
    DEPTH,
    FIELDS,
    INTENSITY,
    MARGIN,
    SCORE,
    SLOPE_COL,
    SLOPE_ROW,
    STD,
    WINDOW,
)
from srt3d_ros.kernels.cuda.match import CELLS, PIXELS, peak
from srt3d_ros.kernels.cuda.scratch import borrow, constant

FAINTEST, APART, DIMMEST, STAY = (tl.constexpr(getattr(constants, name)) for name in (
    "FAINTEST", "APART", "DIMMEST", "STAY"))
COLS, CHANNELS = 32, 16         # columns and channels whose rows one program pools


@triton.jit
def _is_open(exposure, state, i, j, inside, wide, LAYER: tl.constexpr, SURFACES: tl.constexpr):
    """Whether pixels (i, j) of the image are used, have no surface LAYER, but one before it."""
    pixel = (i + MARGIN) * wide + j + MARGIN
    found = state + (((i + MARGIN) * SURFACES + LAYER) * FIELDS + INTENSITY) * wide + j + MARGIN
    lit = tl.load(exposure + pixel, mask=inside, other=0.0) > 0.0
    is_open = inside & lit & (tl.load(found, mask=inside, other=1.0) == 0.0)
    if LAYER > 0:
        is_open = is_open & (tl.load(found - FIELDS * wide, mask=inside, other=0.0) > 0.0)
    return is_open


@triton.jit
def _pool_rows(matched, noise, exposure, state, weights, rows, cols, wide, channels, out, LAYER: tl.constexpr,
               SURFACES: tl.constexpr, STEP: tl.constexpr, TAPS: tl.constexpr, COLS: tl.constexpr,
               CHANNELS: tl.constexpr):
    """Sums over rows of what open pixels show: channels of the sketch, then exposure, then noise, weights squared."""
    j, c = tl.program_id(0) * COLS + tl.arange(0, COLS), tl.program_id(1) * CHANNELS + tl.arange(0, CHANNELS)[:, None]
    first = tl.program_id(2) * STEP - (TAPS - STEP) // 2
    total = tl.zeros([CHANNELS, COLS], tl.float32)
    light, photons = tl.zeros([COLS], tl.float32), tl.zeros([COLS], tl.float32)
    for tap in tl.range(TAPS, loop_unroll_factor=4):
        i, weight = first + tap, tl.load(weights + tap)
        pixel = (i + MARGIN) * wide + j + MARGIN
        inside = j < tl.where((i >= 0) & (i < rows), cols, 0)
        seen = _is_open(exposure, state, i, j, inside, wide, LAYER, SURFACES)
        source = matched + ((i + MARGIN) * channels + c) * wide + (j + MARGIN)[None, :]
        total += weight * tl.load(source, mask=seen[None, :] & (c < channels), other=0.0)
        light += weight * tl.load(exposure + pixel, mask=seen, other=0.0)
        photons += weight * weight * tl.load(noise + pixel, mask=seen, other=0.0)
    into, inside = out + tl.program_id(2) * (channels + 2) * cols + j, j < cols
    tl.store(into[None, :] + c * cols, total, mask=inside[None, :] & (c < channels))
    inside = j < tl.where(tl.program_id(1) == 0, cols, 0)
    tl.store(into + channels * cols, light, mask=inside)
    tl.store(into + (channels + 1) * cols, photons, mask=inside)


@triton.jit
def _score(signal, noise, squash, total, greatest, worth, STEPS: tl.constexpr):
    """Evidence of a matched filter against "background alone", as `_score` in kernels/cpu/search.py."""
    photons = tl.maximum(noise / squash, DIMMEST)
    at = tl.minimum(tl.maximum(signal / photons * (total / greatest * STEPS), 0.0), STEPS)
    low = tl.minimum(at.to(tl.int32), STEPS - 1)
    below, above = tl.load(worth + low), tl.load(worth + low + 1)
    return tl.sqrt(photons / squash) * (below + (at - low.to(tl.float32)) * (above - below))


@triton.jit
def _rarer(score, depth, clutter, BINS: tl.constexpr):
    """The score in standard deviations of the background at this depth; BINS of `clutter`, 0 for none."""
    if BINS > 0:
        score = score / tl.load(clutter + tl.floor(depth + 0.5).to(tl.int32) % BINS)
    return score


@triton.jit
def _std(signal, noise, squash, moments, curvature, period):
    """Standard deviation of a depth found in a window, bins; arguments as of `_score`."""
    signal = tl.maximum(signal, DIMMEST)
    background = tl.maximum(noise / squash - signal, 0.0)
    spread = squash * (signal * tl.load(moments) + background * tl.load(moments + 1))
    return tl.minimum(tl.sqrt(spread) / (signal * curvature), period)


@triton.jit
def _decide(matched, noise, light, line, across, line_of_one, exposure, state, carried, weights, squash, window, enough,
            confirmed, energy, cycles, curvature, greatest, worth, moments, clutter, period, rows, cols, wide, m,
            WARM: tl.constexpr, LAYER: tl.constexpr, SURFACES: tl.constexpr, STEP: tl.constexpr, TAPS: tl.constexpr,
            STEPS: tl.constexpr, BINS: tl.constexpr, M: tl.constexpr, PIXELS: tl.constexpr, CELLS: tl.constexpr):
    """Pool the columns of PIXELS cells of a row, match the pools, and write the surfaces of those that are sure.

    Args:
        matched, noise, light: pools of rows, or the maps themselves.
        line, across, line_of_one: from a row, and a channel, of `matched` to the next; from one of the others.
        WARM: whether there are carried surfaces.
        BINS: of `clutter`; 0 for none.
    """
    cell_row, cell, l = tl.program_id(1), tl.program_id(0) * PIXELS + tl.arange(0, PIXELS), tl.arange(0, M)
    some = tl.zeros([PIXELS], tl.int32)
    for own in tl.range(STEP * STEP, loop_unroll_factor=4):
        i, j = cell_row * STEP + own // STEP, cell * STEP + own % STEP
        inside = j < tl.where(i < rows, cols, 0)
        some |= _is_open(exposure, state, i, j, inside, wide, LAYER, SURFACES).to(tl.int32)
    if tl.max(some, axis=0) == 0:
        return

    re, im = tl.zeros([M, PIXELS], tl.float32), tl.zeros([M, PIXELS], tl.float32)
    photons, lit = tl.zeros([PIXELS], tl.float32), tl.zeros([PIXELS], tl.float32)
    for tap in tl.range(TAPS, loop_unroll_factor=4):
        j, weight = cell * STEP + (tap - (TAPS - STEP) // 2), tl.load(weights + tap)
        inside = (j >= 0) & (j < cols)
        at, known = matched + cell_row * line + l[:, None] * across + j[None, :], (l < m)[:, None] & inside[None, :]
        re += weight * tl.load(at, mask=known, other=0.0)
        im += weight * tl.load(at + m * across, mask=known, other=0.0)
        lit += weight * tl.load(light + cell_row * line_of_one + j, mask=inside, other=0.0)
        photons += weight * weight * tl.load(noise + cell_row * line_of_one + j, mask=inside, other=0.0)

    share = tl.load(energy + l, mask=l < m, other=0.0)
    cycle = tl.load(cycles + l, mask=l < m, other=0.0)
    total = tl.sum(share)
    depth, height = peak(re, im, tl.floor(cycle * period + 0.5), period, CELLS)
    depth, signal = depth - period * tl.floor(depth / period), height / total
    score = _score(signal, photons, squash, total, greatest, worth, STEPS)
    score = _rarer(score, depth, clutter, BINS)
    intensity, std = signal / tl.maximum(lit, DIMMEST), _std(signal, photons, squash, moments, curvature, period)
    apart = APART * tl.sqrt(total / curvature)
    for own in range(STEP * STEP):
        i, j = cell_row * STEP + own // STEP, cell * STEP + own % STEP
        inside = j < tl.where(i < rows, cols, 0)
        room = _is_open(exposure, state, i, j, inside, wide, LAYER, SURFACES)
        record = (i + MARGIN) * SURFACES * FIELDS * wide + j + MARGIN
        new, first = room & (score > enough), state + record
        if LAYER > 0:       # a surface beside those that the pixel has: resolved from them, and not too faint
            new = new & (intensity > tl.load(first + INTENSITY * wide, mask=new, other=0.0) * FAINTEST)
            for k in tl.static_range(LAYER):
                known = first + k * FIELDS * wide
                e = wrap(tl.load(known + DEPTH * wide, mask=new, other=0.0) - depth, period)
                there = tl.load(known + INTENSITY * wide, mask=new, other=0.0) > 0.0
                new = new & ~((tl.abs(e) <= apart) & there)
        into = first + LAYER * FIELDS * wide
        if WARM:
            old = carried + record + LAYER * FIELDS * wide
            stays = room & (tl.load(old + INTENSITY * wide, mask=room, other=0.0) > 0.0)
            was = tl.load(old + DEPTH * wide, mask=stays, other=0.0)
            sine, cosine = sincos(cycle[:, None] * was[None, :])
            shown = tl.sum(re * cosine + im * sine, axis=0) / total
            known = _rarer(_score(shown, photons, squash, total, greatest, worth, STEPS), was, clutter, BINS)
            stays = stays & (known > confirmed) & (score * score - known * known < 2.0 * STAY)
            new = new & ~stays
            tl.debug_barrier()
            tl.store(into + DEPTH * wide, was, mask=stays)
            tl.store(into + SLOPE_COL * wide, tl.load(old + SLOPE_COL * wide, mask=stays, other=0.0), mask=stays)
            tl.store(into + SLOPE_ROW * wide, tl.load(old + SLOPE_ROW * wide, mask=stays, other=0.0), mask=stays)
            tl.store(into + INTENSITY * wide, shown / tl.maximum(lit, DIMMEST), mask=stays)
            tl.store(into + STD * wide, _std(shown, photons, squash, moments, curvature, period), mask=stays)
            tl.store(into + WINDOW * wide, window, mask=stays)
            tl.store(into + SCORE * wide, known, mask=stays)
        tl.debug_barrier()      # threads that share a pixel have all seen it open
        tl.store(into + DEPTH * wide, depth, mask=new)
        tl.store(into + SLOPE_COL * wide, 0.0, mask=new)
        tl.store(into + SLOPE_ROW * wide, 0.0, mask=new)
        tl.store(into + INTENSITY * wide, intensity, mask=new)
        tl.store(into + STD * wide, std, mask=new)
        tl.store(into + WINDOW * wide, window, mask=new)
        tl.store(into + SCORE * wide, score, mask=new)


def search(data, matched, state, layer, sigma, weights, step, enough, scratch=None, carried=None, confirmed=0.0):
    """Give the open pixels of which one scale is sure their surface.

    Open are pixels that are used, have no surface `layer`, but one before it. With a window only what open pixels show
    is pooled, else surfaces would grow over pixels that see background alone.

    Args:
        data: the frame, padded.
        matched: float32 [rows', 2m, cols'], the frame's, or what known surfaces leave of it.
        state: float32 [rows', K, FIELDS, cols'], changed in place.
        layer: which surface of the pixels is searched for.
        sigma: of the window, pixels; 0: every pixel on its own.
        weights: float32, a NumPy array, of the window, as for `blur`.
        step: pixels along the side of the cells that share a window.
        enough: the score that is enough, standard deviations.
        scratch: memory to use.
        carried: float32 [rows', K, FIELDS, cols'], surfaces of the last frame. One for which there is a score above
            `confirmed` is kept, unless another is better by STAY nats.
        confirmed: see there, standard deviations.
    """
    (rows, cols), channels, wide, surfaces = data.shape, matched.shape[1], matched.shape[2], state.shape[1]
    high, m = triton.cdiv(rows, step), channels // 2
    weights, sizes = constant(weights), {"LAYER": layer, "SURFACES": surfaces, "STEP": step, "TAPS": len(weights)}
    if sigma > 0:
        pools = borrow(scratch, "pools", (high, channels + 2, cols))
        _pool_rows[(triton.cdiv(cols, COLS), triton.cdiv(channels, CHANNELS), high)](
            matched, data.noise, data.exposure, state, weights, rows, cols, wide, channels, pools, **sizes, COLS=COLS,
            CHANNELS=CHANNELS)
        maps = pools, pools[:, channels + 1], pools[:, channels]
        lines, squash = ((channels + 2) * cols, cols, (channels + 2) * cols), 0.5
    else:
        maps = (values[layout.MARGIN:, ..., layout.MARGIN:] for values in (matched, data.noise, data.exposure))
        lines, squash = (channels * wide, wide, wide), 1.0
    clutter, bins = (data.noise, 0) if data.clutter is None else (data.clutter, len(data.clutter))
    _decide[(triton.cdiv(triton.cdiv(cols, step), PIXELS), high)](
        *maps, *lines, data.exposure, state, state if carried is None else carried, weights, squash,
        max(sigma, constants.NARROWEST), enough, confirmed, data.energy, data.cycles, data.curvature,
        data.greatest_response, data.rarity, data.moments, clutter, float(data.num_bins), rows, cols, wide, m,
        WARM=carried is not None, **sizes, STEPS=len(data.rarity) - 1, BINS=bins, M=max(axis(m), 16), PIXELS=PIXELS,
        CELLS=CELLS, num_warps=4)


def drop_weak(state, weak):
    """Remove the points with a score below `weak` standard deviations, in place: they are searched for anew."""
    state[:, :, layout.INTENSITY].masked_fill_(state[:, :, layout.SCORE] < weak, 0.0)
