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

BLOCK points that lie side by side go through each step together, in vector registers: x counts them. `kernels.torch`
has the notation; `kernels.torch.method.pooled_step` explains the standard deviation and the residual.
"""

from typing import NamedTuple

import numpy as np
from numba import boolean, float32, int64, prange

from srt3d_ros.kernels.constants import CELL, RIDGE
from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, TINY, ZERO, B, U, aligned
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.method import field
from srt3d_ros.kernels.cpu.method.field import agreement, rise, wrap
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.cpu.method.likelihood import evidence
from srt3d_ros.kernels.maps import BLOCK, MARGIN

POINTS = "depth", "slope_col", "slope_row", "tolerance"         # t, slopes, max_chi2 · std²
NEIGHBOUR = "weight", "apart"                                   # w, e of the neighbours that are being added
POOLED = "value", "gradient", "curvature", "squares", "photons", "exposure"     # V, S, B, N, p, G
LEVER = "lever_col", "lever_row"                                # Σ w b dx, Σ w b dy
# Σ f, Σ f dx, Σ f dy, Σ f dx², Σ f dy², Σ f dx dy, Σ f e, Σ f e dx, Σ f e dy, Σ f e²
PLANE = "fit", "fit_x", "fit_y", "fit_xx", "fit_yy", "fit_xy", "fit_e", "fit_xe", "fit_ye", "fit_ee"
# Of the row of neighbours that is being added: Σ w b, Σ f, Σ f dx, Σ f e
ROW = "row_curvature", "row_fit", "row_fit_x", "row_fit_e"
FITTED = "bend", "leverage", "off", "spread"                    # max(B, V₊ C / 2E), and three parts of the residual
# One record: the compiler then knows that its arrays do not overlap, which it must to compute in vector registers.
POOL = np.dtype([(name, np.float32, BLOCK) for name in POINTS + NEIGHBOUR + POOLED + LEVER + PLANE + ROW + FITTED])
POOL_SIZE = POOL.itemsize // 4


class Window(NamedTuple):
    """Which surfaces a pool adds, and with which weights."""

    weights: float32[::1]       # exp(−d² / 2σ²) for d = 0, 1, … pixels along a row or column
    most: int64                 # dx² + dy² in the window, pixels²
    max_chi2: float32
    period: float32             # T, bins
    fits_plane: boolean         # whether their depths are added, too


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


class Place(NamedTuple):
    """Neighbours in the columns from `col` on, dx and dy pixels from the points."""

    col: int
    dx: float
    dy: float


EVEN = np.ones(CELL // 2 + 1, np.float32)       # weights in a cell


@inline
def _begin(pool, points, col, max_chi2):
    """Load the points in the columns from `col` on, and set the sums of their windows to 0."""
    for x in range(B):
        std = points[field.STD, col + x]
        pool.depth[x] = points[field.DEPTH, col + x]
        pool.slope_col[x] = points[field.SLOPE_COL, col + x]
        pool.slope_row[x] = points[field.SLOPE_ROW, col + x]
        pool.tolerance[x] = max_chi2 * std * std + TINY
        pool.value[x] = pool.gradient[x] = pool.curvature[x] = ZERO
        pool.squares[x] = pool.photons[x] = pool.exposure[x] = pool.lever_col[x] = pool.lever_row[x] = ZERO
        pool.fit[x] = pool.fit_x[x] = pool.fit_y[x] = pool.fit_xx[x] = pool.fit_yy[x] = pool.fit_xy[x] = ZERO
        pool.fit_e[x] = pool.fit_xe[x] = pool.fit_ye[x] = pool.fit_ee[x] = ZERO


@inline
def _add(pool, surfaces, terms, at, nearness, window):
    """Add the data terms of neighbours; `nearness` is the first factor of their weight."""
    for x in range(B):
        plane = pool.depth[x] + rise(pool.slope_col[x], pool.slope_row[x], at.dx, at.dy)
        e = wrap(surfaces[field.DEPTH, at.col + x] - plane, window.period)
        std = surfaces[field.STD, at.col + x]
        same = agreement(e, pool.tolerance[x] + window.max_chi2 * std * std)
        w = nearness * same * same
        bend = w * terms[field.CURVATURE, at.col + x]
        slope = w * terms[field.GRADIENT, at.col + x]
        bend_e = bend * e
        pool.weight[x], pool.apart[x] = w, e
        pool.value[x] += w * terms[field.VALUE, at.col + x] - e * (slope + HALF * bend_e)
        pool.gradient[x] += slope + bend_e
        pool.row_curvature[x] += bend
        pool.lever_col[x] += bend * at.dx
        pool.squares[x] += w * w * terms[field.SQUARES, at.col + x]
        pool.photons[x] += w * terms[field.COUNTS, at.col + x]
        pool.exposure[x] += w * terms[field.EXPOSURE, at.col + x]


@inline
def _add_to_plane(pool, surfaces, at, pixels):
    """Add the depths of neighbours, each of which stands for so many pixels, to the sums of the planes."""
    for x in range(B):
        std = surfaces[field.STD, at.col + x]
        there = surfaces[field.INTENSITY, at.col + x] > ZERO
        f = pixels * pool.weight[x] / (std * std + TINY) if there else ZERO
        f_e = f * pool.apart[x]
        pool.row_fit[x] += f
        pool.row_fit_x[x] += f * at.dx
        pool.fit_xx[x] += f * (at.dx * at.dx)
        pool.row_fit_e[x] += f_e
        pool.fit_xe[x] += f_e * at.dx
        pool.fit_ee[x] += f_e * pool.apart[x]


@inline
def _end_row(pool, dy):
    """Add the sums of a row of neighbours, dy below the points, to those of the window."""
    for x in range(B):
        pool.curvature[x] += pool.row_curvature[x]
        pool.lever_row[x] += pool.row_curvature[x] * dy
        pool.fit[x] += pool.row_fit[x]
        pool.fit_x[x] += pool.row_fit_x[x]
        pool.fit_y[x] += pool.row_fit[x] * dy
        pool.fit_yy[x] += pool.row_fit[x] * (dy * dy)
        pool.fit_xy[x] += pool.row_fit_x[x] * dy
        pool.fit_e[x] += pool.row_fit_e[x]
        pool.fit_ye[x] += pool.row_fit_e[x] * dy


@line
def _add_grid(pool, row, col, grid, window, state, terms):
    """Add the neighbours that are on the grid and in the window of the points at `row` and from `col` on."""
    for dy in range(-grid.reach, grid.reach + 1, grid.step):
        for x in range(B):
            pool.row_curvature[x] = pool.row_fit[x] = pool.row_fit_x[x] = pool.row_fit_e[x] = ZERO
        for dx in range(-grid.reach, grid.reach + 1, grid.step):
            if max(abs(dx), abs(dy)) > grid.beyond and dx * dx + dy * dy <= window.most:
                nearness = window.weights[abs(dx)] * window.weights[abs(dy)]
                at = Place(U(col + dx), F32(dx), F32(dy))
                for k in range(U(state.shape[1])):
                    surfaces = state[U(row + dy), k]
                    _add(pool, surfaces, terms[U(row + dy), k], at, nearness, window)
                    if window.fits_plane:
                        _add_to_plane(pool, surfaces, at, F32(grid.step * grid.step))
        _end_row(pool, F32(dy))


@inline
def _fit_plane(pool, total, curvature):
    """Turn the planes to the least-squares fit, and the pooled gradient with them; leave what `_finish` takes.

    The ridge holds a slope to 0 as one measurement of it with variance C / E would.
    """
    steepness = curvature / total
    for x in range(B):
        f = pool.fit[x] + TINY
        ridge = steepness / f + F32(RIDGE)
        mx, my, me = pool.fit_x[x] / f, pool.fit_y[x] / f, pool.fit_e[x] / f
        cxx, cyy = pool.fit_xx[x] / f - mx * mx + ridge, pool.fit_yy[x] / f - my * my + ridge
        cxy = pool.fit_xy[x] / f - mx * my
        # e is how far a neighbour is off the plane so far; the ridge holds the whole slope, not its change.
        cxe = pool.fit_xe[x] / f - mx * me - ridge * pool.slope_col[x]
        cye = pool.fit_ye[x] / f - my * me - ridge * pool.slope_row[x]
        det = cxx * cyy - cxy * cxy
        turn_col, turn_row = (cyy * cxe - cxy * cye) / det, (cxx * cye - cxy * cxe) / det
        pool.gradient[x] -= turn_col * pool.lever_col[x] + turn_row * pool.lever_row[x]
        pool.slope_col[x] += turn_col
        pool.slope_row[x] += turn_row
        bend = max(pool.curvature[x], HALF * max(pool.value[x], ZERO) * steepness) + TINY
        col, row = pool.lever_col[x] / bend, pool.lever_row[x] / bend
        pool.bend[x] = bend
        pool.leverage[x] = (cyy * col * col - 2 * cxy * col * row + cxx * row * row) / det
        pool.off[x] = me - turn_col * mx - turn_row * my
        pool.spread[x] = max(pool.fit_ee[x] / f - me * me - turn_col * cxe - turn_row * cye, ZERO)


@inline
def _finish(pool, before, after, col, max_chi2, frame):
    """Step to the top of the pooled data term and write the next state."""
    total, curvature, period = frame.total_energy, frame.curvature, frame.period
    by_signal, by_background, by_bins, of_bins = frame.moments[0], frame.moments[1], frame.moments[2], frame.moments[3]
    for x in range(B):
        photons, squares, known = pool.photons[x], pool.squares[x], pool.tolerance[x] / max_chi2
        seen = before[field.INTENSITY, col + x] > ZERO
        d = min(max(pool.gradient[x] / pool.bend[x], -frame.resolution), frame.resolution)
        value = pool.value[x] + d * (pool.gradient[x] - HALF * d * pool.curvature[x])
        depth = pool.depth[x] + d
        strength = max(value, ZERO) / total
        signal = min(strength, photons)
        variance = (signal * by_signal + (photons - signal) * by_background) * squares / max(photons, TINY)
        std = min(np.sqrt(variance) / max(signal * curvature, TINY), period)
        off = pool.off[x] - d
        relief = max(pool.spread[x] + off * off - max(known - std * std, ZERO), ZERO)
        bowl = relief * relief / (relief + std * std + TINY)
        bins = by_bins * squares / max(photons * signal * curvature * curvature, TINY) + of_bins
        residual = np.sqrt(std * std * pool.leverage[x] + relief + bowl + bins)
        after[field.DEPTH, col + x] = depth - period * np.floor(depth / period)
        after[field.SLOPE_COL, col + x] = pool.slope_col[x]
        after[field.SLOPE_ROW, col + x] = pool.slope_row[x]
        intensity = max(strength / max(pool.exposure[x], TINY), TINY)
        after[field.INTENSITY, col + x] = intensity if seen else ZERO
        after[field.STD, col + x] = std if signal > ZERO else period
        after[field.RESIDUAL, col + x] = residual if signal > ZERO else ZERO
        pool.value[x] = value if seen else ZERO
    for x in range(B):                  # a loop of its own: a lookup in a table runs in no vector register
        score = evidence(pool.value[x], pool.photons[x], pool.squares[x], frame)
        after[field.SCORE, col + x] = score


@parallel
def _pooled_step(frame: Frame, window: Window, radius: int64, fine: int64, maps: Maps):
    rows, surfaces, _, cols = maps.state.shape
    for turn in prange(rows - 2 * MARGIN):
        scratch, row = aligned(POOL_SIZE).view(POOL), turn + MARGIN
        for col in range(MARGIN, cols - MARGIN, BLOCK):
            for k in range(surfaces):
                pool = scratch[0]           # here, for a record does not keep the memory of its array
                _begin(pool, maps.state[row, k], U(col), window.max_chi2)
                _add_grid(pool, row, col, Grid(min(radius, fine), -1, 1), window, maps.state, maps.terms)
                if radius > fine:
                    _add_grid(pool, row, col, Grid(radius // CELL * CELL, fine, CELL), window, maps.state, maps.cells)
                _fit_plane(pool, frame.total_energy, frame.curvature)
                _finish(pool, maps.state[row, k], maps.out[row, k], U(col), window.max_chi2, frame)


@parallel
def _coarsen(window: Window, maps: Maps):
    """Write the terms of the cells around the points, pooled along their planes."""
    rows, surfaces, _, cols = maps.state.shape
    for turn in prange(rows - 2 * MARGIN):
        scratch, row = aligned(POOL_SIZE).view(POOL), turn + MARGIN
        for col in range(MARGIN, cols - MARGIN, BLOCK):
            for k in range(surfaces):
                pool, points, cells = scratch[0], maps.state[row, k], maps.cells[row, k]
                _begin(pool, points, U(col), window.max_chi2)
                _add_grid(pool, row, col, Grid(CELL // 2, -1, 1), window, maps.state, maps.terms)
                for x in range(B):
                    seen = points[field.INTENSITY, U(col) + x] > ZERO
                    cells[field.VALUE, U(col) + x] = pool.value[x] if seen else ZERO
                    cells[field.GRADIENT, U(col) + x] = pool.gradient[x] if seen else ZERO
                    cells[field.CURVATURE, U(col) + x] = pool.curvature[x] if seen else ZERO
                    cells[field.SQUARES, U(col) + x] = pool.squares[x] if seen else ZERO
                    cells[field.COUNTS, U(col) + x] = pool.photons[x] if seen else ZERO
                    cells[field.EXPOSURE, U(col) + x] = pool.exposure[x] if seen else ZERO


def pooled_step(frame, state, terms, sigma, radius, fine, max_chi2):
    out = borrow("stepped", state.shape)
    out = borrow("stepped again", state.shape) if out is state else out
    maps = Maps(state, terms, borrow("cells", terms.shape), out)
    if radius > fine:
        _coarsen(Window(EVEN, 2 * (CELL // 2)**2, F32(max_chi2), F32(frame.num_bins), False), maps)
    weights = np.exp(-np.arange(radius + 1)**2 / (2 * sigma**2)).astype(np.float32)
    window = Window(weights, radius * (radius + 1), F32(max_chi2), F32(frame.num_bins), True)
    _pooled_step(frame, window, radius, fine, maps)
    return out
