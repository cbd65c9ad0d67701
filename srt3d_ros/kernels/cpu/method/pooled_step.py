"""Gauss-Newton step of every point on Σ_q w_q f_q, the data terms of its window moved along its tangent plane.

f_q(t_q + d) = v + s d − b d² / 2 are the terms of `expand` for the surface q of the neighbour (dx, dy) pixels away, at
e = wrap(t_q − t − slopes · (dx, dy)) bins off the point's plane. With the weight

    w = exp(−(dx² + dy²) / 2σ²) · (1 − e² / max_chi2 (std² + std_q²))₊²

the pool of a point is the sum over its round window, dx² + dy² ≤ radius (radius + 1), of

    V = Σ w (v − s e − b e² / 2),  S = Σ w (s + b e),  B = Σ w b,  N = Σ w² n,  p = Σ w n,  G = Σ w g.

The plane is fitted to the depths of the window by least squares, with weights f = w / std_q², CELL² times as much for a
cell (`_turn`). Its turn moves S by −turn · Σ w b (dx, dy). The point then steps by d = S / max(B, V₊ C / 2E), at
most δ, to the top of the pooled data term, R = V + d S − d² B / 2, and gets intensity R₊ / (E G) and score
p / √N · ρ(R₊ / p) (`_step`). A pool of value V has a curvature of V C / E on average: half of it keeps a B that noise
made small from causing a long step.

Neighbours within the square of `fine` pixels count one by one, farther ones in cells of CELL × CELL pixels: the same
sums over the cell, with w = the second factor alone, along the plane of its middle point (`_coarsen_row`). A cell
without a point in its middle is empty. `fine` is 1 + 3 i, so that cells begin where it ends.

Each vector holds LANES points that lie side by side. Along a row of neighbours dy is the same, so that what is weighted
by dy is added up along the row first. `kernels.torch` has the notation; `kernels.torch.method.pooled_step` explains the
standard deviation and the residual.
"""

from typing import NamedTuple

import numpy as np
from numba import float32, int64, prange

from srt3d_ros.kernels.constants import CELL, RIDGE
from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, ONE, TINY, TWO, ZERO, agreement, wrap
from srt3d_ros.kernels.cpu.compiling import floats1d, floats4d, inline, line, parallel
from srt3d_ros.kernels.cpu.method.frame import Frame, Terms, columns, point_at, put
from srt3d_ros.kernels.cpu.method.likelihood import evidence
from srt3d_ros.kernels.cpu.vectors import floats, floor, fma, full, lanes_of, load, sqrt, store, where
from srt3d_ros.kernels.maps import (
    COUNTS,
    CURVATURE,
    DEPTH,
    EXPOSURE,
    GRADIENT,
    INTENSITY,
    LANES,
    MARGIN,
    RESIDUAL,
    SCORE,
    SLOPE_COL,
    SLOPE_ROW,
    SQUARES,
    STD,
    VALUE,
)

EVEN = np.ones(CELL // 2 + 1, np.float32)       # weights in a cell
TOLERANCE, PRECISION = range(2)                 # of `known`: max_chi2 · std², and 1 / std² (0: no point)


class Window(NamedTuple):
    """Which surfaces a pool adds, and with which weights."""

    weights: floats1d           # exp(−d² / 2σ²) for d = 0, 1, … pixels along a row or column
    most: int64                 # greatest dx² + dy² in the window, pixels²
    max_chi2: float32
    period: float32             # T, bins


class Maps(NamedTuple):
    """What a step reads and writes, [rows', K, …, cols'] each."""

    state: floats4d     # the points
    known: floats4d     # how well their depths are known: TOLERANCE and PRECISION
    terms: floats4d     # of `expand`
    cells: floats4d     # the terms of the cells around the points
    out: floats4d       # the next points


class Grid(NamedTuple):
    """Every step-th row and column more than `beyond` and up to `reach` pixels away."""

    reach: int
    beyond: int
    step: int


class Plane(NamedTuple):
    """The tangent planes of points, and how far they may be off."""

    depth: floats               # t
    slope_col: floats
    slope_row: floats
    tolerance: floats           # max_chi2 · std²


class Each(NamedTuple):
    """Sums without dy, added up neighbour by neighbour."""

    value: floats               # V
    gradient: floats            # S
    squares: floats             # N
    photons: floats             # p
    exposure: floats            # G
    bend_x: floats              # Σ w b dx
    xx: floats                  # Σ f dx²
    xe: floats                  # Σ f dx e
    ee: floats                  # Σ f e²


class Row(NamedTuple):
    """Sums over a row of neighbours: Σ w b, Σ f, Σ f dx, Σ f e."""

    bend: floats
    f: floats
    x: floats
    e: floats


class Rows(NamedTuple):
    """Sums over the rows, of `Row` and of what dy multiplies."""

    curvature: floats           # B
    bend_y: floats              # Σ w b dy
    f: floats                   # Σ f
    x: floats                   # Σ f dx
    y: floats                   # Σ f dy
    yy: floats                  # Σ f dy²
    xy: floats                  # Σ f dx dy
    e: floats                   # Σ f e
    ye: floats                  # Σ f dy e


@inline
def _add(each, row, plane, place, offset, nearness, pixels, period, state, known, terms):
    """Add the surfaces k of neighbours. `nearness` is exp(−distance² / 2σ²), `pixels` 1 or, of a cell, CELL²."""
    (i, k, j), (dx, dy) = place, offset
    depth = fma(plane.slope_col, dx, fma(plane.slope_row, dy, plane.depth))
    e = wrap(load(state, i, k, DEPTH, j) - depth, period)
    same = agreement(e, load(known, i, k, TOLERANCE, j) + plane.tolerance)
    w = nearness * same * same
    wb, ws = w * load(terms, i, k, CURVATURE, j), w * load(terms, i, k, GRADIENT, j)
    wbe = wb * e
    f = pixels * w * load(known, i, k, PRECISION, j)
    fx, fe = f * dx, f * e
    return (
        Each(each.value + (w * load(terms, i, k, VALUE, j) - e * fma(wbe, HALF, ws)), each.gradient + ws + wbe,
             fma(w * w, load(terms, i, k, SQUARES, j), each.squares),
             fma(w, load(terms, i, k, COUNTS, j), each.photons),
             fma(w, load(terms, i, k, EXPOSURE, j), each.exposure), fma(wb, dx, each.bend_x),
             fma(fx, dx, each.xx), fma(fx, e, each.xe), fma(fe, e, each.ee)),
        Row(row.bend + wb, row.f + f, row.x + fx, row.e + fe))


@line
def _add_grid(each, rows, plane, place, grid, window, state, known, terms):
    """Add the neighbours that are on the grid and in the window of the points at `place`."""
    (i, j), pixels, zero = place, F32(grid.step * grid.step), full(ZERO)
    for dy in range(-grid.reach, grid.reach + 1, grid.step):
        row, y = Row(zero, zero, zero, zero), F32(dy)
        for dx in range(-grid.reach, grid.reach + 1, grid.step):
            if max(abs(dx), abs(dy)) > grid.beyond and dx * dx + dy * dy <= window.most:
                nearness = window.weights[abs(dx)] * window.weights[abs(dy)]
                for k in range(state.shape[1]):
                    each, row = _add(each, row, plane, (i + dy, k, j + dx), (F32(dx), y), nearness, pixels,
                                     window.period, state, known, terms)
        rows = Rows(rows.curvature + row.bend, fma(row.bend, y, rows.bend_y), rows.f + row.f, rows.x + row.x,
                    fma(row.f, y, rows.y), fma(row.f, y * y, rows.yy), fma(row.x, y, rows.xy), rows.e + row.e,
                    fma(row.e, y, rows.ye))
    return each, rows


@inline
def _begin(state, i, k, j, max_chi2):
    """The planes of points, and sums of nothing."""
    point, zero = point_at(state, i, k, j), full(ZERO)
    plane = Plane(point.depth, point.slope_col, point.slope_row, max_chi2 * point.std * point.std + TINY)
    return (plane, Each(zero, zero, zero, zero, zero, zero, zero, zero, zero),
            Rows(zero, zero, zero, zero, zero, zero, zero, zero, zero))


@inline
def _turn(each, rows, plane, steepness):
    """The least-squares turn of the planes: its slopes, max(B, V₊ C / 2E), and three parts of the residual.

    They are the leverage x̄ᵀ X⁻¹ x̄ (x̄: Σ w b offset over that maximum; X: the covariance of offsets, with the
    ridge), and mean and variance of the distances from the new plane. The ridge acts as a measurement of slope 0
    with variance E / C.
    """
    f = rows.f + TINY
    ridge = steepness / f + F32(RIDGE)
    x, y, e = rows.x / f, rows.y / f, rows.e / f
    xx, yy, xy = each.xx / f - x * x + ridge, rows.yy / f - y * y + ridge, rows.xy / f - x * y
    # e is how far a neighbour is off the plane so far; the ridge holds the whole slope, not its change.
    xe, ye = each.xe / f - x * e - ridge * plane.slope_col, rows.ye / f - y * e - ridge * plane.slope_row
    det = xx * yy - xy * xy
    turn_col, turn_row = (yy * xe - xy * ye) / det, (xx * ye - xy * xe) / det
    bend = max(rows.curvature, HALF * max(each.value, ZERO) * steepness) + TINY
    col, row = each.bend_x / bend, rows.bend_y / bend
    leverage = (yy * col * col - TWO * xy * col * row + xx * row * row) / det
    spread = max(each.ee / f - e * e - turn_col * xe - turn_row * ye, ZERO)
    return turn_col, turn_row, bend, max(leverage, ZERO), e - turn_col * x - turn_row * y, spread


@line
def _step(place, each, rows, frame, state, out):
    """Turn the planes, step to the top of the pooled data term, and write the next points."""
    (i, k, j), total, curvature, period = place, frame.total_energy, frame.curvature, frame.period
    point = point_at(state, i, k, j)
    by_signal, by_background, by_bins, of_bins = frame.moments[0], frame.moments[1], frame.moments[2], frame.moments[3]
    turn_col, turn_row, bend, leverage, off, spread = _turn(each, rows, point, curvature / total)
    gradient = each.gradient - turn_col * each.bend_x - turn_row * rows.bend_y
    d = min(max(gradient / bend, -frame.resolution), frame.resolution)
    value = each.value + d * (gradient - HALF * d * rows.curvature)             # R
    strength, photons, squares = max(value, ZERO) / total, each.photons, each.squares
    signal = min(strength, photons)                                             # S'
    variance = (signal * by_signal + (photons - signal) * by_background) * squares / max(photons, TINY)
    std = min(sqrt(variance) / max(signal * curvature, TINY), period)
    relief = max(spread + (off - d) * (off - d) - max(point.std * point.std - std * std, ZERO), ZERO)       # q
    bowl = relief * relief / (relief + std * std + TINY)
    bins = by_bins * squares / max(photons * signal * curvature * curvature, TINY) + of_bins
    residual = sqrt(std * std * leverage + relief + bowl + bins)
    seen, depth = point.intensity > 0, point.depth + d
    store(out, i, k, DEPTH, j, depth - period * floor(depth / period))
    store(out, i, k, SLOPE_COL, j, point.slope_col + turn_col)
    store(out, i, k, SLOPE_ROW, j, point.slope_row + turn_row)
    store(out, i, k, INTENSITY, j, where(seen, max(strength / max(each.exposure, TINY), TINY), 0))
    store(out, i, k, STD, j, where(signal > 0, std, period))
    store(out, i, k, SCORE, j, where(seen, evidence(value, photons, squares, frame), 0))
    store(out, i, k, RESIDUAL, j, where(signal > 0, residual, 0))


@line
def _step_row(i, radius, fine, window, frame, maps):
    state = maps.state
    near, far = Grid(min(radius, fine), -1, 1), Grid(radius // CELL * CELL, fine, CELL)
    for j in columns(state):
        for k in range(state.shape[1]):
            if lanes_of(load(state, i, k, INTENSITY, j) > 0) == 0:     # then no other field is valid
                store(maps.out, i, k, INTENSITY, j, ZERO)
                store(maps.out, i, k, SCORE, j, ZERO)
                continue
            plane, each, rows = _begin(state, i, k, j, window.max_chi2)
            each, rows = _add_grid(each, rows, plane, (i, j), near, window, state, maps.known, maps.terms)
            if radius > fine:
                each, rows = _add_grid(each, rows, plane, (i, j), far, window, state, maps.known, maps.cells)
            _step((i, k, j), each, rows, frame, state, maps.out)


@line
def _coarsen_row(i, cell, maps):
    """Write the terms of the cells around the points, pooled along their planes."""
    grid, state = Grid(CELL // 2, -1, 1), maps.state
    for j in columns(state):
        for k in range(state.shape[1]):
            plane, each, rows = _begin(state, i, k, j, cell.max_chi2)
            each, rows = _add_grid(each, rows, plane, (i, j), grid, cell, state, maps.known, maps.terms)
            pooled = Terms(each.value, each.gradient, rows.curvature, each.squares, each.photons, each.exposure)
            put(maps.cells, i, k, j, where(load(state, i, k, INTENSITY, j) > 0, pooled, 0))


@line
def _weigh_row(i, max_chi2, state, known):
    """Write how well the depths of points are known, once for all windows that they are in."""
    for j in range(0, state.shape[3], LANES):
        for k in range(state.shape[1]):
            point = point_at(state, i, k, j)
            variance = point.std * point.std
            store(known, i, k, TOLERANCE, j, max_chi2 * variance)
            store(known, i, k, PRECISION, j, where(point.intensity > 0, ONE / (variance + TINY), 0))


@parallel
def _pooled_step(frame: Frame, window: Window, cell: Window, radius: int64, fine: int64, maps: Maps):
    for i in prange(len(maps.state)):
        _weigh_row(i, window.max_chi2, maps.state, maps.known)
    for row in prange(len(maps.state) - 2 * MARGIN if radius > fine else 0):
        _coarsen_row(row + MARGIN, cell, maps)
    for row in prange(len(maps.state) - 2 * MARGIN):
        _step_row(row + MARGIN, radius, fine, window, frame, maps)


def pooled_step(work, frame, state, terms, sigma, radius, fine, max_chi2):
    out, max_chi2, period = work.other_state(state), F32(max_chi2), F32(frame.num_bins)
    weights = np.exp(-np.arange(radius + 1)**2 / (2 * sigma**2)).astype(np.float32)
    window = Window(weights, radius * (radius + 1), max_chi2, period)
    cell = Window(EVEN, 2 * (CELL // 2)**2, max_chi2, period)
    _pooled_step(frame, window, cell, radius, fine, Maps(state, work.known, terms, work.cell_terms, out))
    return out
