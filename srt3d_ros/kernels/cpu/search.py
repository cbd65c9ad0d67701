"""One scale of the start: pool the sketches of open pixels, match them, and give sure pools' pixels their surface."""

import numpy as np
from numba import prange

from srt3d_ros.core.layout import BLOCK, DEPTH, INTENSITY, MARGIN, SCORE, SLOPE_COL, SLOPE_ROW, STD, WINDOW
from srt3d_ros.kernels.constants import APART, DIMMEST, FAINTEST, NARROWEST, STAY
from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, ONE, TWO, ZERO, aligned, total_of, wrap
from srt3d_ros.kernels.cpu.blur import pool
from srt3d_ros.kernels.cpu.compiling import inline, parallel
from srt3d_ros.kernels.cpu.match import load, peaks, peaks_scratch, response_at, steering
from srt3d_ros.kernels.cpu.scratch import borrow


@parallel
def _find_open(exposure, state, layer, left):
    rows, cols = left.shape
    for i in prange(rows):
        a = i + MARGIN
        for j in range(cols):
            b = j + MARGIN
            is_open = exposure[a, b] > ZERO and state[a, layer, INTENSITY, b] == ZERO
            if layer > 0:
                is_open = is_open and state[a, layer - 1, INTENSITY, b] > ZERO
            left[i, j] = ONE if is_open else ZERO


@inline
def _score(signal, noise, squash, total, greatest, worth):
    """Evidence of a matched filter against "background alone", standard deviations; also right for few photons.

    Args:
        signal: Σ w r.
        noise: Σ w² n.
        squash: Σ w² / Σ w of the window: 1 for a single pixel, 1/2 for a Gaussian.
        total, greatest, worth: the Frame's total_energy, greatest_response and rarity.
    """
    photons, steps = max(noise / squash, DIMMEST), len(worth) - 1
    at = min(max(signal / photons * (total / greatest * F32(steps)), ZERO), F32(steps))
    low = min(int(at), steps - 1)
    return np.sqrt(photons / squash) * (worth[low] + (at - F32(low)) * (worth[low + 1] - worth[low]))


@inline
def _std(signal, noise, squash, moments, curvature, period):
    """Standard deviation of a depth found in a window, bins; arguments as of `_score`."""
    signal = max(signal, DIMMEST)
    background = max(noise / squash - signal, ZERO)
    spread = squash * (signal * moments[0] + background * moments[1])
    return min(np.sqrt(spread) / (signal * curvature), period)


@inline
def _is_new(state, a, layer, b, depth, intensity, apart, period):
    """Whether a surface stands beside those that pixel (a, b) already has: resolved from them, and not too faint."""
    new = intensity > FAINTEST * state[a, 0, INTENSITY, b]
    for k in range(layer):
        near = abs(wrap(state[a, k, DEPTH, b] - depth, period)) <= apart
        new = new and not (near and state[a, k, INTENSITY, b] > ZERO)
    return new


@inline
def _measure(state, a, layer, b, intensity, std, sigma, score):
    """Write what a window of σ `sigma` tells of the surface of pixel (a, b)."""
    state[a, layer, INTENSITY, b], state[a, layer, STD, b] = intensity, std
    state[a, layer, WINDOW, b], state[a, layer, SCORE, b] = max(sigma, NARROWEST), score


@parallel
def _decide(matched, noise, exposure, top, left, step, squash, sigma, enough, energy, curvature, greatest, worth,
            moments, clutter, cycles, cos, sin, odd, cells, num_bins, is_open, layer, carried, confirmed, state):
    rows, cols = is_open.shape
    m, total, period = len(energy), total_of(energy), F32(num_bins)
    apart, warm, rarest = APART * np.sqrt(total / curvature), carried.shape[0] > 0, worth.max()
    for i in prange(-(-rows // step)):
        scratch, z = peaks_scratch(cells), aligned(2 * m * BLOCK)
        place, height = aligned(BLOCK), aligned(BLOCK)
        last_row = min((i + 1) * step, rows)
        for first in range(0, -(-cols // step), BLOCK):
            width = min(BLOCK, -(-cols // step) - first)
            if is_open[i * step:last_row, first * step:(first + width) * step].sum() == ZERO:
                continue
            most = noise[top + i, left + first:left + first + width].max()
            if not warm and np.sqrt(most) / squash * rarest <= enough:
                continue                                # so few photons cannot be sure, wherever they are
            load(z, matched, top + i, left + first, width)
            peaks(z, cos, sin, odd, cells, period, scratch, place, height)
            for x in range(width):
                j = first + x
                signal, photons, light = height[x] / total, noise[top + i, left + j], exposure[top + i, left + j]
                depth = place[x] - period * np.floor(place[x] / period)
                score = _score(signal, photons, squash, total, greatest, worth)
                score /= clutter[int(np.rint(depth)) % len(clutter)]
                if score <= enough and not warm:
                    continue
                intensity = signal / max(light, DIMMEST)
                for p in range(i * step, last_row):
                    for q in range(j * step, min((j + 1) * step, cols)):
                        a, b = p + MARGIN, q + MARGIN
                        if is_open[p, q] == ZERO:
                            continue
                        if warm and carried[a, layer, INTENSITY, b] > ZERO:
                            old = response_at(z, x, BLOCK, cycles, carried[a, layer, DEPTH, b]) / total
                            known = _score(old, photons, squash, total, greatest, worth)
                            known /= clutter[int(np.rint(carried[a, layer, DEPTH, b])) % len(clutter)]
                            if known > confirmed and score * score - known * known < TWO * F32(STAY):
                                for f in (DEPTH, SLOPE_COL, SLOPE_ROW):
                                    state[a, layer, f, b] = carried[a, layer, f, b]
                                std = _std(old, photons, squash, moments, curvature, period)
                                _measure(state, a, layer, b, old / max(light, DIMMEST), std, sigma, known)
                                continue
                        if score > enough and (layer == 0 or _is_new(state, a, layer, b, depth, intensity, apart,
                                                                     period)):
                            state[a, layer, DEPTH, b] = depth
                            state[a, layer, SLOPE_COL, b], state[a, layer, SLOPE_ROW, b] = ZERO, ZERO
                            std = _std(signal, photons, squash, moments, curvature, period)
                            _measure(state, a, layer, b, intensity, std, sigma, score)


@parallel
def _drop_weak(state, weak):
    tall, surfaces, _, wide = state.shape
    for i in prange(tall):
        for k in range(surfaces):
            for j in range(wide):
                if state[i, k, SCORE, j] < weak:
                    state[i, k, INTENSITY, j] = ZERO


def drop_weak(state, weak):
    """Remove the points with a score below `weak` standard deviations, in place: they are searched for anew."""
    _drop_weak(state, F32(weak))


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
        weights: float32, of the window, as for `blur`; not used if sigma is 0.
        step: pixels along the side of the cells that share a window.
        enough: the score that is enough, standard deviations.
        scratch: memory to use.
        carried: float32 [rows', K, FIELDS, cols'], surfaces of the last frame. One for which there is a score above
            `confirmed` is kept, unless another is better by STAY nats.
        confirmed: see there, standard deviations.
    """
    rows, cols = data.shape
    carried = np.empty((0, 0, 0, 0), np.float32) if carried is None else carried
    is_open = borrow(scratch, "open", (rows, cols))
    _find_open(data.exposure, state, layer, is_open)
    if not is_open.any():
        return
    maps, top, squash = (matched, data.noise, data.exposure), MARGIN, ONE
    if sigma > 0:
        maps = pool(*maps, is_open, weights, step, scratch)
        top, squash = 0, HALF
    clutter = np.ones(1, np.float32) if data.clutter is None else data.clutter
    _decide(*maps, top, top, step, squash, F32(sigma), F32(enough), data.energy, F32(data.curvature),
            F32(data.greatest_response), data.rarity, data.moments, clutter, data.cycles,
            *steering(data.cycles, data.num_bins), data.num_bins, is_open, layer, carried, F32(confirmed), state)
