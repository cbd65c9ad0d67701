"""Pool data terms along every point's tangent plane, step to the top of their sum, fit the plane.

A pool's BLOCK neighbouring columns go through each step together, in vector registers. What they need lies in one flat
scratch array, at offsets known when compiling, and indices are unsigned: only so can the compiler see that the parts do
not overlap, and that no index counts from the end.
"""

import numpy as np
from numba import float32, int64, prange, types

from srt3d_ros.kernels.constants import CELL, RIDGE
from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, TINY, ZERO, B, U, aligned
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.method import field
from srt3d_ros.kernels.cpu.method.field import agreement, rise, wrap
from srt3d_ros.kernels.cpu.method.frame import FRAME, as_compiled
from srt3d_ros.kernels.cpu.method.likelihood import evidence
from srt3d_ros.kernels.maps import BLOCK, FIELDS, MARGIN, TERMS

# Offsets into the scratch array: points; neighbour; sums for the pool, the first six as in the terms; for the plane;
# sums of the row of neighbours that is being added, each of 1, dx or dx².
(T, SC, SR, TOLERANCE, W, E,
 V, G, C, S2, S1, X, CX, CY,
 P, PX, PY, PXX, PYY, PXY, PE, PXE, PYE, PEE,
 ROW_C, ROW_P, ROW_PX, ROW_PE) = (U(k * BLOCK) for k in range(28))
BEND, LEVERAGE, OFF, SPREAD = P, PX, PE, PEE    # of the step and the plane, in place of sums they are made of
SCRATCH = 28 * BLOCK
EVEN = np.ones(CELL // 2 + 1, np.float32)       # weights in a cell
SHAPE = types.UniTuple(int64, 4)


@inline
def _begin(s, state, point, padded_cols, max_chi2):
    """Load the points, and empty the sums of the window."""
    for x in range(B):
        s[T + x] = state[point + field.DEPTH * padded_cols + x]
        s[SC + x] = state[point + field.SLOPE_COL * padded_cols + x]
        s[SR + x] = state[point + field.SLOPE_ROW * padded_cols + x]
        std = state[point + field.STD * padded_cols + x]
        s[TOLERANCE + x] = max_chi2 * std * std + TINY
    for x in range(ROW_C - V):
        s[V + x] = ZERO


@inline
def _add(s, state, terms, at, term, padded_cols, dx, dy, near, max_chi2, period):
    """Add the surfaces of the neighbours at (dx, dy) to the pools.

    They count by distance and by agreement with the plane, e bins off which their data terms are moved along it:
    f(t − e) = v − s e − b e² / 2, f′ = s + b e, −f″ = b.
    """
    v, g = term + field.VALUE * padded_cols, term + field.GRADIENT * padded_cols
    c, squares = term + field.CURVATURE * padded_cols, term + field.SQUARES * padded_cols
    counts, exposure = term + field.COUNTS * padded_cols, term + field.EXPOSURE * padded_cols
    for x in range(B):
        plane = s[T + x] + rise(s[SC + x], s[SR + x], dx, dy)
        e = wrap(state[at + field.DEPTH * padded_cols + x] - plane, period)
        std = state[at + field.STD * padded_cols + x]
        same = agreement(e, s[TOLERANCE + x] + max_chi2 * std * std)
        w = near * same * same
        bend, slope = w * terms[c + x], w * terms[g + x]
        bend_e = bend * e
        s[W + x], s[E + x] = w, e
        s[V + x] += w * terms[v + x] - e * (slope + HALF * bend_e)
        s[G + x] += slope + bend_e
        s[ROW_C + x] += bend
        s[CX + x] += bend * dx
        s[S2 + x] += w * w * terms[squares + x]
        s[S1 + x] += w * terms[counts + x]
        s[X + x] += w * terms[exposure + x]


@inline
def _add_to_plane(s, state, at, padded_cols, dx, pixels):
    """Add the neighbours' depths to the sums of the planes, each weighed by its variance and its number of pixels."""
    for x in range(B):
        std = state[at + field.STD * padded_cols + x]
        p = pixels * s[W + x] / (std * std + TINY) if state[at + field.INTENSITY * padded_cols + x] > ZERO else ZERO
        off = p * s[E + x]
        s[ROW_P + x] += p
        s[ROW_PX + x] += p * dx
        s[PXX + x] += p * (dx * dx)
        s[ROW_PE + x] += off
        s[PXE + x] += off * dx
        s[PEE + x] += off * s[E + x]


@inline
def _end_row(s, dy):
    """Add the sums of a row of neighbours, dy below the points, to those of the window."""
    for x in range(B):
        s[C + x] += s[ROW_C + x]
        s[CY + x] += s[ROW_C + x] * dy
        s[P + x] += s[ROW_P + x]
        s[PX + x] += s[ROW_PX + x]
        s[PY + x] += s[ROW_P + x] * dy
        s[PYY + x] += s[ROW_P + x] * (dy * dy)
        s[PXY + x] += s[ROW_PX + x] * dy
        s[PE + x] += s[ROW_PE + x]
        s[PYE + x] += s[ROW_PE + x] * dy


@line
def _add_grid(s, state, terms, i, j, padded_cols, surfaces, reach, step, nearest, most, weights, in_plane, max_chi2,
              period):
    """Add every step-th neighbour that is more than `nearest` and up to `reach` away, and dx² + dy² up to `most`."""
    for dy in range(-reach, reach + 1, step):
        for x in range(U(SCRATCH) - ROW_C):             # empty the sums of a row
            s[ROW_C + x] = ZERO
        for dx in range(-reach, reach + 1, step):
            if max(abs(dx), abs(dy)) > nearest and dx * dx + dy * dy <= most:
                near, right, down = weights[abs(dx)] * weights[abs(dy)], F32(dx), F32(dy)
                pixel = ((i + dy) * surfaces) * padded_cols
                at, term = U(pixel * FIELDS + j + dx), U(pixel * TERMS + j + dx)
                for q in range(U(surfaces)):
                    mine = at + q * U(FIELDS * padded_cols)
                    _add(s, state, terms, mine, term + q * U(TERMS * padded_cols), U(padded_cols), right, down, near,
                         max_chi2, period)
                    if in_plane:
                        _add_to_plane(s, state, mine, U(padded_cols), right, F32(step * step))
        _end_row(s, F32(dy))


@inline
def _fit_plane(s, total, curvature):
    """Turn the planes to the least-squares fit, and the pooled slope with them; leave what `residual` is made of.

    A slope is held to 0 as by one measurement with variance total / curvature.
    """
    steepness = curvature / total
    for x in range(B):
        p = s[P + x] + TINY
        ridge = steepness / p + F32(RIDGE)
        mx, my, me = s[PX + x] / p, s[PY + x] / p, s[PE + x] / p
        cxx, cyy = s[PXX + x] / p - mx * mx + ridge, s[PYY + x] / p - my * my + ridge
        cxy = s[PXY + x] / p - mx * my
        # e is what a neighbour is off the plane so far; the ridge holds the whole slope, not its change.
        cxe = s[PXE + x] / p - mx * me - ridge * s[SC + x]
        cye = s[PYE + x] / p - my * me - ridge * s[SR + x]
        det = cxx * cyy - cxy * cxy
        turn_col, turn_row = (cyy * cxe - cxy * cye) / det, (cxx * cye - cxy * cxe) / det
        s[G + x] -= turn_col * s[CX + x] + turn_row * s[CY + x]
        s[SC + x] += turn_col
        s[SR + x] += turn_row
        bend = max(s[C + x], HALF * max(s[V + x], ZERO) * steepness) + TINY
        col, row = s[CX + x] / bend, s[CY + x] / bend
        s[BEND + x] = bend
        s[LEVERAGE + x] = (cyy * col * col - 2 * cxy * col * row + cxx * row * row) / det
        s[OFF + x] = me - turn_col * mx - turn_row * my
        s[SPREAD + x] = max(s[PEE + x] / p - me * me - turn_col * cxe - turn_row * cye, ZERO)


@inline
def _finish(s, state, point, out, padded_cols, max_chi2, frame):
    """Step to the top of the pooled data term and write the next state."""
    total, curvature, moments, period = frame.total_energy, frame.curvature, frame.moments, frame.period
    for x in range(B):
        seen = state[point + field.INTENSITY * padded_cols + x] > ZERO
        d = min(max(s[G + x] / s[BEND + x], -frame.resolution), frame.resolution)
        value = s[V + x] + d * (s[G + x] - HALF * d * s[C + x])
        t = s[T + x] + d
        strength = max(value, ZERO) / total
        signal = min(strength, s[S1 + x])
        variance = (signal * moments[0] + (s[S1 + x] - signal) * moments[1]) * s[S2 + x] / max(s[S1 + x], TINY)
        std = min(np.sqrt(variance) / max(signal * curvature, TINY), period)
        out[point + field.DEPTH * padded_cols + x] = t - period * np.floor(t / period)
        out[point + field.SLOPE_COL * padded_cols + x] = s[SC + x]
        out[point + field.SLOPE_ROW * padded_cols + x] = s[SR + x]
        out[point + field.INTENSITY * padded_cols + x] = max(strength / max(s[X + x], TINY), TINY) if seen else ZERO
        out[point + field.STD * padded_cols + x] = std if signal > ZERO else period
        off = s[OFF + x] - d
        relief = max(s[SPREAD + x] + off * off - max(s[TOLERANCE + x] / max_chi2 - std * std, ZERO), ZERO)
        bowl = relief * relief / (relief + std * std + TINY)
        bins = moments[2] * s[S2 + x] / max(s[S1 + x] * signal * curvature * curvature, TINY) + moments[3]
        residual = np.sqrt(std * std * s[LEVERAGE + x] + relief + bowl + bins)
        out[point + field.RESIDUAL * padded_cols + x] = residual if signal > ZERO else ZERO
        s[V + x] = value if seen else ZERO
    for x in range(B):                  # apart: no vector register looks up a table
        score = evidence(s[V + x], s[S1 + x], s[S2 + x], frame)
        out[point + field.SCORE * padded_cols + x] = score


@parallel
def _pooled_step(frame: FRAME, max_chi2: float32, radius: int64, fine: int64, weights: float32[::1], shape: SHAPE,
                 state: float32[::1], terms: float32[::1], cells: float32[::1], out: float32[::1]):
    padded_rows, surfaces, fields, padded_cols = shape
    period, most = frame.period, radius * (radius + 1)
    for row in prange(padded_rows - 2 * MARGIN):
        i = row + MARGIN
        s = aligned(SCRATCH)
        for j in range(MARGIN, padded_cols - MARGIN, BLOCK):
            for k in range(surfaces):
                point = U((i * surfaces + k) * fields * padded_cols + j)
                _begin(s, state, point, U(padded_cols), max_chi2)
                # Near neighbours one by one, farther ones cell by cell.
                _add_grid(s, state, terms, i, j, padded_cols, surfaces, min(radius, fine), 1, -1, most, weights, True,
                          max_chi2, period)
                if radius > fine:
                    _add_grid(s, state, cells, i, j, padded_cols, surfaces, radius // CELL * CELL, CELL, fine, most,
                              weights, True, max_chi2, period)
                _fit_plane(s, frame.total_energy, frame.curvature)
                _finish(s, state, point, out, U(padded_cols), max_chi2, frame)


@parallel
def _coarsen(num_bins: int64, max_chi2: float32, shape: SHAPE, state: float32[::1], terms: float32[::1],
             cells: float32[::1]):
    """The data terms of cells of CELL × CELL pixels, along the plane of the middle one's surface."""
    padded_rows, surfaces, fields, padded_cols = shape
    half = CELL // 2
    for row in prange(padded_rows - 2 * MARGIN):
        i = row + MARGIN
        s = aligned(SCRATCH)
        for j in range(MARGIN, padded_cols - MARGIN, BLOCK):
            for k in range(surfaces):
                point = U((i * surfaces + k) * fields * padded_cols + j)
                _begin(s, state, point, U(padded_cols), max_chi2)
                _add_grid(s, state, terms, i, j, padded_cols, surfaces, half, 1, -1, 2 * half**2, EVEN, False,
                          max_chi2, F32(num_bins))
                into = U((i * surfaces + k) * TERMS * padded_cols + j)
                for f in range(U(TERMS)):
                    for x in range(B):
                        seen = state[point + field.INTENSITY * U(padded_cols) + x] > ZERO
                        cells[into + f * U(padded_cols) + x] = s[V + f * B + x] if seen else ZERO


def pooled_step(frame, state, terms, sigma, radius, fine, max_chi2):
    out = borrow("stepped", state.shape)
    out = borrow("stepped again", state.shape) if out is state else out
    weights = np.exp(-np.arange(radius + 1)**2 / (2 * sigma**2)).astype(np.float32)
    cells, flat = terms, (state.reshape(-1), terms.reshape(-1))
    if radius > fine:
        cells = borrow("cells", terms.shape)
        _coarsen(frame.num_bins, F32(max_chi2), state.shape, *flat, cells.reshape(-1))
    _pooled_step(as_compiled(frame), F32(max_chi2), radius, fine, weights, state.shape, *flat, cells.reshape(-1),
                 out.reshape(-1))
    return out
