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
sums over the cell, with w = the second factor alone, along the plane of its middle point (`_coarsen`). A cell
without a point in its middle is empty. `fine` is 1 + 3 i, so that cells begin where it ends.

Each vector holds LANES points that lie side by side. Along a row of neighbours dy is the same, so that what is weighted
by dy is added up along the row first. `kernels.torch` has the notation; `kernels.torch.method.pooled_step` explains the
standard deviation and the residual.
"""

from typing import NamedTuple

import numpy as np
from numba import float32, int64

from srt3d_ros.kernels.constants import CELL, RIDGE, TINY
from srt3d_ros.kernels.cpu.arithmetic import F32, agreement, wrap
from srt3d_ros.kernels.cpu.compiling import each, floats1d, floats4d, inline, line
from srt3d_ros.kernels.cpu.method.frame import Frame, Point, point_at
from srt3d_ros.kernels.cpu.method.likelihood import evidence
from srt3d_ros.kernels.cpu.vectors import floats, floor, fma, full, lanes_of, sqrt, where
from srt3d_ros.kernels.maps import (
    COUNTS,
    CURVATURE,
    DEPTH,
    EXPOSURE,
    GRADIENT,
    INTENSITY,
    RESIDUAL,
    SCORE,
    SLOPE_COL,
    SLOPE_ROW,
    SQUARES,
    STD,
    TERMS,
    VALUE,
)

EVEN = np.ones(CELL // 2 + 1, np.float32)       # weights in a cell
TOLERANCE, PRECISION = range(2)                 # of `known`: max_chi2 · std², and 1 / std² (0: no point)


class Window(NamedTuple):
    """Which surfaces a pool adds, and with which weights."""

    weights: floats1d           # exp(−d² / 2σ²) for d = 0, 1, … pixels along a row or column
    most: int64                 # greatest dx² + dy² in the window, pixels²
    max_chi2: float32


class Grid(NamedTuple):
    """Every step-th row and column more than `beyond` and up to `reach` pixels away."""

    reach: int
    beyond: int
    step: int


class Sums(NamedTuple):
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
def _add(sums, row, point, tolerance, place, offset, nearness, pixels, period, state, known, terms):
    """Add the surfaces k of neighbours. `nearness` is exp(−distance² / 2σ²), `pixels` 1 or, of a cell, CELL²."""
    (i, k, j), (dx, dy) = place, offset
    depth = fma(point.slope_col, dx, fma(point.slope_row, dy, point.depth))
    e = wrap(state[i, k, DEPTH, j] - depth, period)
    same = agreement(e, known[i, k, TOLERANCE, j] + tolerance)
    w = nearness * same * same
    wb, ws = w * terms[i, k, CURVATURE, j], w * terms[i, k, GRADIENT, j]
    wbe = wb * e
    f = pixels * w * known[i, k, PRECISION, j]
    fx, fe = f * dx, f * e
    return (
        Sums(sums.value + (w * terms[i, k, VALUE, j] - e * fma(wbe, 0.5, ws)), sums.gradient + ws + wbe,
             fma(w * w, terms[i, k, SQUARES, j], sums.squares), fma(w, terms[i, k, COUNTS, j], sums.photons),
             fma(w, terms[i, k, EXPOSURE, j], sums.exposure), fma(wb, dx, sums.bend_x),
             fma(fx, dx, sums.xx), fma(fx, e, sums.xe), fma(fe, e, sums.ee)),
        Row(row.bend + wb, row.f + f, row.x + fx, row.e + fe))


@line
def _add_grid(sums, rows, point, tolerance, i, j, grid, window, period, state, known, terms):
    """Add the neighbours that are on the grid and in the window of the points (i, j)."""
    pixels, zero = F32(grid.step * grid.step), full(0.0)
    for dy in range(-grid.reach, grid.reach + 1, grid.step):
        row, y = Row(zero, zero, zero, zero), F32(dy)
        for dx in range(-grid.reach, grid.reach + 1, grid.step):
            if max(abs(dx), abs(dy)) > grid.beyond and dx * dx + dy * dy <= window.most:
                nearness = window.weights[abs(dx)] * window.weights[abs(dy)]
                for k in range(state.shape[1]):
                    sums, row = _add(sums, row, point, tolerance, (i + dy, k, j + dx), (F32(dx), y), nearness, pixels,
                                     period, state, known, terms)
        rows = Rows(rows.curvature + row.bend, fma(row.bend, y, rows.bend_y), rows.f + row.f, rows.x + row.x,
                    fma(row.f, y, rows.y), fma(row.f, y * y, rows.yy), fma(row.x, y, rows.xy), rows.e + row.e,
                    fma(row.e, y, rows.ye))
    return sums, rows


@inline
def _begin(point, max_chi2):
    """How far points may be off their planes, squared, and sums of nothing."""
    zero = full(0.0)
    return (max_chi2 * point.std * point.std + TINY, Sums(zero, zero, zero, zero, zero, zero, zero, zero, zero),
            Rows(zero, zero, zero, zero, zero, zero, zero, zero, zero))


@inline
def _turn(sums, rows, point, steepness):
    """The least-squares turn of the planes: its slopes, max(B, V₊ C / 2E), and three parts of the residual.

    They are the leverage x̄ᵀ X⁻¹ x̄ (x̄: Σ w b offset over that maximum; X: the covariance of offsets, with the
    ridge), and mean and variance of the distances from the new plane. The ridge acts as a measurement of slope 0
    with variance E / C.
    """
    f = rows.f + TINY
    ridge = steepness / f + RIDGE
    x, y, e = rows.x / f, rows.y / f, rows.e / f
    xx, yy, xy = sums.xx / f - x * x + ridge, rows.yy / f - y * y + ridge, rows.xy / f - x * y
    # e is how far a neighbour is off the plane so far; the ridge holds the whole slope, not its change.
    xe, ye = sums.xe / f - x * e - ridge * point.slope_col, rows.ye / f - y * e - ridge * point.slope_row
    det = xx * yy - xy * xy
    turn_col, turn_row = (yy * xe - xy * ye) / det, (xx * ye - xy * xe) / det
    bend = max(rows.curvature, 0.5 * max(sums.value, 0) * steepness) + TINY
    col, row = sums.bend_x / bend, rows.bend_y / bend
    leverage = (yy * col * col - 2 * xy * col * row + xx * row * row) / det
    spread = max(sums.ee / f - e * e - turn_col * xe - turn_row * ye, 0)
    return turn_col, turn_row, bend, max(leverage, 0), e - turn_col * x - turn_row * y, spread


@line
def _stepped(point, sums, rows, frame):
    """The points with turned planes, at the top of the pooled data term."""
    total, curvature, period = frame.total_energy, frame.curvature, frame.period
    by_signal, by_background, by_bins, of_bins = frame.moments[0], frame.moments[1], frame.moments[2], frame.moments[3]
    turn_col, turn_row, bend, leverage, off, spread = _turn(sums, rows, point, curvature / total)
    gradient = sums.gradient - turn_col * sums.bend_x - turn_row * rows.bend_y
    d = min(max(gradient / bend, -frame.resolution), frame.resolution)
    value = sums.value + d * (gradient - 0.5 * d * rows.curvature)              # R
    strength, photons, squares = max(value, 0) / total, sums.photons, sums.squares
    signal = min(strength, photons)                                             # S'
    variance = (signal * by_signal + (photons - signal) * by_background) * squares / max(photons, TINY)
    std = min(sqrt(variance) / max(signal * curvature, TINY), period)
    relief = max(spread + (off - d) * (off - d) - max(point.std * point.std - std * std, 0), 0)       # q
    bowl = relief * relief / (relief + std * std + TINY)
    bins = by_bins * squares / max(photons * signal * curvature * curvature, TINY) + of_bins
    residual = sqrt(std * std * leverage + relief + bowl + bins)
    seen, depth = point.intensity > 0, point.depth + d
    return Point(depth - period * floor(depth / period), point.slope_col + turn_col, point.slope_row + turn_row,
                 where(seen, max(strength / max(sums.exposure, TINY), TINY), 0), where(signal > 0, std, period),
                 where(seen, evidence(value, photons, squares, frame), 0), where(signal > 0, residual, 0))


def _weigh(i, j, window: Window, state: floats4d, known: floats4d):
    """Write how well the depths of points are known, once for all windows that they are in."""
    for k in range(state.shape[1]):
        point = point_at(state, i, k, j)
        variance = point.std * point.std
        known[i, k, TOLERANCE, j] = window.max_chi2 * variance
        known[i, k, PRECISION, j] = where(point.intensity > 0, 1 / (variance + TINY), 0)


def _coarsen(i, j, frame: Frame, cell: Window, radius: int64, fine: int64, known: floats4d, terms: floats4d,
             cells: floats4d, state: floats4d):
    """Write the terms of the cells around the points, pooled along their planes."""
    for k in range(state.shape[1] if radius // CELL * CELL > fine else 0):
        point = point_at(state, i, k, j)
        tolerance, sums, rows = _begin(point, cell.max_chi2)
        sums, rows = _add_grid(sums, rows, point, tolerance, i, j, Grid(CELL // 2, -1, 1), cell, frame.period, state,
                               known, terms)
        there = point.intensity > 0
        cells[i, k, VALUE, j], cells[i, k, GRADIENT, j] = where(there, sums.value, 0), where(there, sums.gradient, 0)
        cells[i, k, CURVATURE, j] = where(there, rows.curvature, 0)
        cells[i, k, SQUARES, j], cells[i, k, COUNTS, j] = where(there, sums.squares, 0), where(there, sums.photons, 0)
        cells[i, k, EXPOSURE, j] = where(there, sums.exposure, 0)


def _step(i, j, frame: Frame, window: Window, radius: int64, fine: int64, state: floats4d, known: floats4d,
          terms: floats4d, cells: floats4d, out: floats4d):
    near, far = Grid(min(radius, fine), -1, 1), Grid(radius // CELL * CELL, fine, CELL)
    for k in range(state.shape[1]):
        point = point_at(state, i, k, j)
        if lanes_of(point.intensity > 0) == 0:      # then no other field is valid
            out[i, k, INTENSITY, j] = out[i, k, SCORE, j] = 0
            continue
        tolerance, sums, rows = _begin(point, window.max_chi2)
        sums, rows = _add_grid(sums, rows, point, tolerance, i, j, near, window, frame.period, state, known, terms)
        if far.reach > fine:
            sums, rows = _add_grid(sums, rows, point, tolerance, i, j, far, window, frame.period, state, known, cells)
        after = _stepped(point, sums, rows, frame)
        out[i, k, DEPTH, j], out[i, k, INTENSITY, j] = after.depth, after.intensity
        out[i, k, SLOPE_COL, j], out[i, k, SLOPE_ROW, j] = after.slope_col, after.slope_row
        out[i, k, STD, j], out[i, k, SCORE, j], out[i, k, RESIDUAL, j] = after.std, after.score, after.residual


_pooled_step = each(_weigh, _coarsen, _step)


def pooled_step(work, frame, state, terms, sigma, radius, fine, max_chi2):
    out, max_chi2 = work.other_state(state), F32(max_chi2)
    weights = np.exp(-np.arange(radius + 1)**2 / (2 * sigma**2)).astype(np.float32)
    window, cell = Window(weights, radius * (radius + 1), max_chi2), Window(EVEN, 2 * (CELL // 2)**2, max_chi2)
    _pooled_step(window, state, work.map("known", work.surfaces, 2), frame, cell, radius, fine, terms,
                 work.map("cells", work.surfaces, TERMS), out)
    return out
