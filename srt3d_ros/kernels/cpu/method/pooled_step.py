"""Gauss-Newton step of every point on Σ_q w_q f_q, the data terms of its window moved along its tangent plane.

f_q(t_q + d) = v + s d − b d² / 2 are the terms of `expand` for the surface q of the neighbour (dx, dy) pixels away, at
e = wrap(t_q − t − slopes · (dx, dy)) bins off the point's plane. With the weight

    w = exp(−(dx² + dy²) / 2σ²) · (1 − e² / max_chi2 (std² + std_q²))₊²

the pool of a point is the sum over its round window, dx² + dy² ≤ radius (radius + 1), of

    V = Σ w (v − s e − b e² / 2),  S = Σ w (s + b e),  B = Σ w b,  N = Σ w² n,  p = Σ w n,  G = Σ w g.

The plane is fitted to the depths of the window by least squares, with weights f = w / std_q², CELL² times as much for a
cell (`_fit_plane`). Its turn moves S by −turn · Σ w b (dx, dy). The point then steps by d = S / max(B, V₊ C / 2E), at
most δ, to the top of the pooled data term, R = V + d S − d² B / 2, and gets intensity R₊ / (E G) and score
p / √N · ρ(R₊ / p) (`_finish`). A pool of value V has a curvature of V C / E on average: half of it keeps a B that noise
made small from causing a long step.

Neighbours within the square of `fine` pixels count one by one, farther ones in cells of CELL × CELL pixels: the same
sums over the cell, with w = the second factor alone, along the plane of its middle point (`_coarsen`).

Each vector holds LANES points that lie side by side. `kernels.torch` has the notation; `kernels.torch.method.pooled_step`
explains the standard deviation and the residual.
"""

from typing import NamedTuple

import numpy as np
from numba import boolean, float32, int64, prange

from srt3d_ros.kernels.constants import CELL, RIDGE
from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, ONE, TINY, TWO, ZERO
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.method.field import agreement, wrap
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.cpu.method.likelihood import evidence
from srt3d_ros.kernels.cpu.vectors import floats, floor, fma, full, lanes_of, load, sqrt, store, where
from srt3d_ros.kernels.maps import (
    COUNTS, CURVATURE, DEPTH, EXPOSURE, GRADIENT, INTENSITY, LANES, MARGIN, RESIDUAL, SCORE, SLOPE_COL, SLOPE_ROW,
    SQUARES, STD, VALUE,
)


class Window(NamedTuple):
    """Which surfaces a pool adds, and with which weights."""

    weights: float32[::1]       # exp(−d² / 2σ²) for d = 0, 1, … pixels along a row or column
    most: int64                 # dx² + dy² in the window, pixels²
    max_chi2: float32
    period: float32             # T, bins


class Maps(NamedTuple):
    """The state and its terms, those of cells, and the next state, float32 [rows', K, …, cols']."""

    state: float32[:, :, :, ::1]
    terms: float32[:, :, :, ::1]
    cells: float32[:, :, :, ::1]
    out: float32[:, :, :, ::1]


class Grid(NamedTuple):
    """Every step-th row and column more than `beyond` and up to `reach` pixels away."""

    reach: int
    beyond: int
    step: int


class Plane(NamedTuple):
    """The tangent planes of points, and how far they may be off."""

    depth: floats           # t
    slope_col: floats
    slope_row: floats
    tolerance: floats       # max_chi2 · std²


class Pool(NamedTuple):
    """Sums over a window: of data terms, and of what their lever is."""

    value: floats           # V
    gradient: floats        # S
    curvature: floats       # B
    squares: floats         # N
    photons: floats         # p
    exposure: floats        # G
    bend_x: floats          # Σ w b dx
    bend_y: floats          # Σ w b dy


class Fit(NamedTuple):
    """Sums of f over a window, times 1, dx, dy, dx², dy², dx dy, e, e dx, e dy and e²."""

    f: floats
    x: floats
    y: floats
    xx: floats
    yy: floats
    xy: floats
    e: floats
    xe: floats
    ye: floats
    ee: floats


EVEN = np.ones(CELL // 2 + 1, np.float32)       # weights in a cell


@inline
def _plane_at(state, row, k, col, max_chi2):
    std = load(state, row, k, STD, col)
    return Plane(load(state, row, k, DEPTH, col), load(state, row, k, SLOPE_COL, col),
                 load(state, row, k, SLOPE_ROW, col), max_chi2 * std * std + TINY)


@inline
def _add(pool, fit, plane, place, offset, nearness, pixels, window, state, terms):
    """Add the surfaces k of neighbours in a row; `nearness` is the first factor of their weight."""
    (row, k, col), (dx, dy) = place, offset
    e = wrap(load(state, row, k, DEPTH, col) - fma(plane.slope_row, dy, fma(plane.slope_col, dx, plane.depth)),
             window.period)
    std = load(state, row, k, STD, col)
    variance = std * std
    same = max(ONE - e * e / fma(variance, window.max_chi2, plane.tolerance), ZERO)
    w = where(load(state, row, k, INTENSITY, col) > ZERO, nearness * same * same, ZERO)
    b, s = w * load(terms, row, k, CURVATURE, col), w * load(terms, row, k, GRADIENT, col)
    b_e = b * e
    pool = Pool(
        pool.value + (w * load(terms, row, k, VALUE, col) - e * fma(b_e, HALF, s)),
        pool.gradient + s + b_e,
        pool.curvature + b,
        fma(w * w, load(terms, row, k, SQUARES, col), pool.squares),
        fma(w, load(terms, row, k, COUNTS, col), pool.photons),
        fma(w, load(terms, row, k, EXPOSURE, col), pool.exposure),
        fma(b, dx, pool.bend_x),
        fma(b, dy, pool.bend_y))
    f = pixels * w / (variance + TINY)
    f_e = f * e
    fit = Fit(fit.f + f, fma(f, dx, fit.x), fma(f, dy, fit.y), fma(f, dx * dx, fit.xx), fma(f, dy * dy, fit.yy),
              fma(f, dx * dy, fit.xy), fit.e + f_e, fma(f_e, dx, fit.xe), fma(f_e, dy, fit.ye), fma(f_e, e, fit.ee))
    return pool, fit


@line
def _sums(place, plane, grid, window, state, terms, sums):
    """The sums over the neighbours that are on the grid and in the window of the points at `place`, added to `sums`."""
    (row, col), (pool, fit), pixels = place, sums, F32(grid.step * grid.step)
    for dy in range(-grid.reach, grid.reach + 1, grid.step):
        for dx in range(-grid.reach, grid.reach + 1, grid.step):
            if max(abs(dx), abs(dy)) > grid.beyond and dx * dx + dy * dy <= window.most:
                nearness = window.weights[abs(dx)] * window.weights[abs(dy)]
                for k in range(state.shape[1]):
                    pool, fit = _add(pool, fit, plane, (row + dy, k, col + dx), (F32(dx), F32(dy)), nearness, pixels,
                                     window, state, terms)
    return pool, fit


@inline
def _turn(pool, fit, plane, steepness):
    """The least-squares turn of the planes, and what it leaves: leverage, mean and mean square of the distances.

    The ridge holds a slope to 0 as one measurement of it with variance C / E would.
    """
    f = fit.f + TINY
    ridge = steepness / f + F32(RIDGE)
    x, y, e = fit.x / f, fit.y / f, fit.e / f
    xx, yy, xy = fit.xx / f - x * x + ridge, fit.yy / f - y * y + ridge, fit.xy / f - x * y
    # e is how far a neighbour is off the plane so far; the ridge holds the whole slope, not its change.
    xe, ye = fit.xe / f - x * e - ridge * plane.slope_col, fit.ye / f - y * e - ridge * plane.slope_row
    det = xx * yy - xy * xy
    turn_col, turn_row = (yy * xe - xy * ye) / det, (xx * ye - xy * xe) / det
    bend = max(pool.curvature, HALF * max(pool.value, ZERO) * steepness) + TINY
    col, row = pool.bend_x / bend, pool.bend_y / bend
    leverage = (yy * col * col - TWO * xy * col * row + xx * row * row) / det
    spread = max(fit.ee / f - e * e - turn_col * xe - turn_row * ye, ZERO)
    return turn_col, turn_row, bend, leverage, e - turn_col * x - turn_row * y, spread


@line
def _step(place, plane, sums, max_chi2, frame, maps):
    """Turn the planes, step to the top of the pooled data term, and write the next points."""
    (row, k, col), (pool, fit) = place, sums
    total, curvature, period = frame.total_energy, frame.curvature, frame.period
    by_signal, by_background, by_bins, of_bins = frame.moments[0], frame.moments[1], frame.moments[2], frame.moments[3]
    turn_col, turn_row, bend, leverage, off, spread = _turn(pool, fit, plane, curvature / total)
    gradient = pool.gradient - turn_col * pool.bend_x - turn_row * pool.bend_y
    d = min(max(gradient / bend, -frame.resolution), frame.resolution)
    value = pool.value + d * (gradient - HALF * d * pool.curvature)                                     # R
    strength = max(value, ZERO) / total
    signal = min(strength, pool.photons)                                                                # S'
    variance = (signal * by_signal + (pool.photons - signal) * by_background) * pool.squares / max(pool.photons, TINY)
    std = min(sqrt(variance) / max(signal * curvature, TINY), period)
    relief = max(spread + (off - d) * (off - d) - max(plane.tolerance / max_chi2 - std * std, ZERO), ZERO)      # q
    bowl = relief * relief / (relief + std * std + TINY)
    bins = by_bins * pool.squares / max(pool.photons * signal * curvature * curvature, TINY) + of_bins
    residual = sqrt(std * std * leverage + relief + bowl + bins)
    seen, depth = load(maps.state, row, k, INTENSITY, col) > ZERO, plane.depth + d
    store(maps.out, row, k, DEPTH, col, depth - period * floor(depth / period))
    store(maps.out, row, k, SLOPE_COL, col, plane.slope_col + turn_col)
    store(maps.out, row, k, SLOPE_ROW, col, plane.slope_row + turn_row)
    store(maps.out, row, k, INTENSITY, col, where(seen, max(strength / max(pool.exposure, TINY), TINY), ZERO))
    store(maps.out, row, k, STD, col, where(signal > ZERO, std, period))
    store(maps.out, row, k, SCORE, col, where(seen, evidence(value, pool.photons, pool.squares, frame), ZERO))
    store(maps.out, row, k, RESIDUAL, col, where(signal > ZERO, residual, ZERO))


@inline
def _nothing():
    z = full(ZERO)
    return Pool(z, z, z, z, z, z, z, z), Fit(z, z, z, z, z, z, z, z, z, z)


@line
def _step_row(row, radius, fine, window, frame, maps):
    surfaces, cols = maps.state.shape[1], maps.state.shape[3]
    for col in range(MARGIN, cols - MARGIN, LANES):
        for k in range(surfaces):
            if lanes_of(load(maps.state, row, k, INTENSITY, col) > ZERO) == 0:
                store(maps.out, row, k, INTENSITY, col, ZERO)
                store(maps.out, row, k, SCORE, col, ZERO)
                continue
            plane = _plane_at(maps.state, row, k, col, window.max_chi2)
            sums = _sums((row, col), plane, Grid(min(radius, fine), -1, 1), window, maps.state, maps.terms, _nothing())
            if radius > fine:
                grid = Grid(radius // CELL * CELL, fine, CELL)
                sums = _sums((row, col), plane, grid, window, maps.state, maps.cells, sums)
            _step((row, k, col), plane, sums, window.max_chi2, frame, maps)


@parallel
def _pooled_step(frame: Frame, window: Window, radius: int64, fine: int64, maps: Maps):
    for turn in prange(len(maps.state) - 2 * MARGIN):
        _step_row(turn + MARGIN, radius, fine, window, frame, maps)


@line
def _coarsen_row(row, window, maps):
    surfaces, cols = maps.state.shape[1], maps.state.shape[3]
    for col in range(MARGIN, cols - MARGIN, LANES):
        for k in range(surfaces):
            plane = _plane_at(maps.state, row, k, col, window.max_chi2)
            pool, _ = _sums((row, col), plane, Grid(CELL // 2, -1, 1), window, maps.state, maps.terms, _nothing())
            seen = load(maps.state, row, k, INTENSITY, col) > ZERO
            store(maps.cells, row, k, VALUE, col, where(seen, pool.value, ZERO))
            store(maps.cells, row, k, GRADIENT, col, where(seen, pool.gradient, ZERO))
            store(maps.cells, row, k, CURVATURE, col, where(seen, pool.curvature, ZERO))
            store(maps.cells, row, k, SQUARES, col, where(seen, pool.squares, ZERO))
            store(maps.cells, row, k, COUNTS, col, where(seen, pool.photons, ZERO))
            store(maps.cells, row, k, EXPOSURE, col, where(seen, pool.exposure, ZERO))


@parallel
def _coarsen(window: Window, maps: Maps):
    """Write the terms of the cells around the points, pooled along their planes."""
    for turn in prange(len(maps.state) - 2 * MARGIN):
        _coarsen_row(turn + MARGIN, window, maps)


def pooled_step(frame, state, terms, sigma, radius, fine, max_chi2):
    out = borrow("stepped", state.shape)
    out = borrow("stepped again", state.shape) if out is state else out
    maps = Maps(state, terms, borrow("cells", terms.shape), out)
    if radius > fine:
        _coarsen(Window(EVEN, 2 * (CELL // 2)**2, F32(max_chi2), F32(frame.num_bins)), maps)
    weights = np.exp(-np.arange(radius + 1)**2 / (2 * sigma**2)).astype(np.float32)
    window = Window(weights, radius * (radius + 1), F32(max_chi2), F32(frame.num_bins))
    _pooled_step(frame, window, radius, fine, maps)
    return out
