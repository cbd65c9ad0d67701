"""Pool data terms along every point's tangent plane, step to the top of their sum, fit the plane.

A thread owns a point. What a pool adds up stays in registers: 9 sums of terms and 9 of the plane. Of each neighbour it
reads 28 bytes from the caches, a warp's 32 points beside each other, and executes some 65 instructions. Neighbours
beyond FINE pixels are taken in cells of CELL × CELL (`_coarsen`): a window of radius 8 has 81 pixels and 16 cells.
"""

import torch
import triton
import triton.language as tl

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cuda.arithmetic import TINY, agreement, fall_of, near, wrap
from srt3d_ros.kernels.cuda.maps import (
    COUNTS,
    CURVATURE,
    DEPTH,
    EXPOSURE,
    FIELDS,
    GRADIENT,
    INTENSITY,
    RESIDUAL,
    SQUARES,
    STD,
    TERMS,
    TILE,
    TILE_ROWS,
    VALUE,
    plane_depth,
    plane_of,
    record_of,
    store_surface,
    tile_pixels,
    tiles,
)

FINE, CELL, RIDGE = (tl.constexpr(getattr(constants, name)) for name in ("FINE", "CELL", "RIDGE"))


@triton.jit
def _store_terms(into, terms, mask, padded_cols):
    """Write terms, in the order of `maps`; 0 outside the mask."""
    for term in tl.static_range(TERMS):
        tl.store(into + term * padded_cols, tl.where(mask, terms[term], 0.0))


@triton.jit
def _weigh(record, depth, point, by_distance, padded_cols):
    """Weights of neighbours' surfaces for a point, their distances from its plane in bins, and their depths' variances.

    `depth` is that of the plane there; `point` the plane, max_chi2 · σ² of its depth (above 0), max_chi2, and T.
    """
    _, variance, max_chi2, period = point
    e, std = wrap(tl.load(record + DEPTH * padded_cols) - depth, period), tl.load(record + STD * padded_cols)
    close = agreement(e, variance + max_chi2 * (std * std))
    return by_distance * close * close, e, std * std


@triton.jit
def _add_to_plane(sums, seen, weight, e, variance, dy, dx):
    """Add neighbours to the sums of the points' planes, each weighed by its variance."""
    f = tl.where(seen, weight / (variance + TINY), 0.0)
    one, x, y, xx, yy, xy, off, x_off, y_off = sums
    return (one + f, x + f * dx, y + f * dy, xx + f * (dx * dx), yy + f * (dy * dy), xy + f * (dx * dy),
            off + f * e, x_off + f * e * dx, y_off + f * e * dy)


@triton.jit
def _fit(sums, plane, steepness):
    """The slopes of the least-squares planes, of the sums of distances from the planes so far.

    A slope is held to 0 as by one measurement with variance 1 / `steepness`.
    """
    one, x, y, xx, yy, xy, off, x_off, y_off = sums
    _, slope_col, slope_row = plane
    one += TINY
    ridge = steepness / one + RIDGE
    x, y, off = x / one, y / one, off / one
    xx, yy, xy = xx / one - x * x, yy / one - y * y, xy / one - x * y
    x_rise = x_off / one - x * off + xx * slope_col + xy * slope_row
    y_rise = y_off / one - y * off + xy * slope_col + yy * slope_row
    xx, yy = xx + ridge, yy + ridge
    det = xx * yy - xy * xy
    return (yy * x_rise - xy * y_rise) / det, (xx * y_rise - xy * x_rise) / det


@triton.jit
def _add_terms(sums, bends, shown, weight, e, dy, dx, padded_cols, CELLS: tl.constexpr):
    """Add weighted terms, each moved from its surface's depth to a plane, e bins away, (dy, dx) pixels from its point.

    Args:
        sums: of the terms, in the order of `maps`.
        bends: sums of curvature times dx, and times dy, by which the gradient changes when the plane is turned; and
            times e².
        CELLS: whether the terms are of cells; of one pixel SQUARES and COUNTS are the same.
    """
    value, gradient, curvature, squares, counts, exposure = sums
    bend_col, bend_row, off_plane = bends
    bend = weight * tl.load(shown + CURVATURE * padded_cols)
    rise = weight * tl.load(shown + GRADIENT * padded_cols)
    photons = tl.load(shown + COUNTS * padded_cols)
    photons2 = tl.load(shown + SQUARES * padded_cols) if CELLS else photons
    light = tl.load(shown + EXPOSURE * padded_cols)
    sums = (value + weight * tl.load(shown + VALUE * padded_cols) - e * (rise + 0.5 * e * bend),
            gradient + rise + e * bend, curvature + bend, squares + weight * weight * photons2,
            counts + weight * photons, exposure + weight * light)
    return sums, (bend_col + bend * dx, bend_row + bend * dy, off_plane + bend * e * e)


@triton.jit
def _add_neighbour(sums, bends, planes, records, terms, point, by_distance, dy, dx, padded_cols,
                   SURFACES: tl.constexpr, CELLS: tl.constexpr, FIT: tl.constexpr):
    """Add the surfaces of neighbours at (dy, dx) to the sums of terms and, if FIT says so, of planes.

    `records` and `terms` point to the points' pixels, surface 0, field or term 0.
    """
    depth = plane_depth(point[0], dy, dx)
    for q in tl.static_range(SURFACES):
        record = records + (dy * SURFACES + q) * FIELDS * padded_cols + dx
        weight, e, variance = _weigh(record, depth, point, by_distance, padded_cols)
        shown = terms + (dy * SURFACES + q) * TERMS * padded_cols + dx
        if FIT:
            seen = tl.load(shown + EXPOSURE * padded_cols) > 0.0                # terms are 0 without a surface
            pixels = weight * (CELL * CELL) if CELLS else weight
            planes = _add_to_plane(planes, seen, pixels, e, variance, dy, dx)
        sums, bends = _add_terms(sums, bends, shown, weight, e, dy, dx, padded_cols, CELLS)
    return sums, bends, planes


@triton.jit
def _no_sums():
    """Sums of the terms, of curvatures times distances, and of the planes, with nothing in them."""
    zero = tl.zeros([TILE], tl.float32)
    planes = (zero, zero, zero, zero, zero, zero, zero, zero, zero)
    return (zero, zero, zero, zero, zero, zero), (zero, zero, zero), planes


@triton.jit
def _pool(records, terms, cells, point, fall, steepness, padded_cols, RADIUS: tl.constexpr, FAR: tl.constexpr,
          SURFACES: tl.constexpr):
    """The sums of `_add_terms` over a round window, and the slopes of the planes through its depths.

    Pixels up to FINE away come first, then cells, whose centres are up to FAR away. Columns are unrolled so that
    several neighbours wait for memory at once, unless that makes too much code.
    """
    sums, bends, planes = _no_sums()
    side: tl.constexpr = RADIUS if RADIUS < FINE else FINE
    for dy in range(-side, side + 1):
        for dx in tl.range(-side, side + 1, loop_unroll_factor=max((2 * side + 1) // SURFACES, 1)):
            inside = dx * dx + dy * dy <= RADIUS * (RADIUS + 1)
            by_distance = tl.where(inside, near(dx * dx + dy * dy, fall), 0.0)
            sums, bends, planes = _add_neighbour(sums, bends, planes, records, terms, point, by_distance, dy, dx,
                                                 padded_cols, SURFACES, False, True)
    if FAR > FINE:
        for dy in range(-FAR, FAR + 1, CELL):
            for dx in tl.range(-FAR, FAR + 1, CELL, loop_unroll_factor=max((2 * FAR // CELL + 1) // SURFACES, 1)):
                if (tl.maximum(dx * dx, dy * dy) > FINE * FINE) & (dx * dx + dy * dy <= RADIUS * (RADIUS + 1)):
                    by_distance = near(dx * dx + dy * dy, fall)
                    sums, bends, planes = _add_neighbour(sums, bends, planes, records, cells, point, by_distance, dy,
                                                         dx, padded_cols, SURFACES, True, True)
    slope_col, slope_row = _fit(planes, point[0], steepness)
    return sums, bends, slope_col, slope_row


@triton.jit
def _newton(value, gradient, curvature, steepness):
    """The step to the top of a parabola, the value there, and the curvature that it was divided by.

    It ends at the width of a peak: where the photons contradict the point the curvature says nothing.
    """
    reach = 1.0 / tl.sqrt(steepness)
    bend = tl.maximum(curvature, 0.5 * tl.maximum(value, 0.0) * steepness) + TINY
    d = tl.minimum(tl.maximum(gradient / bend, -reach), reach)
    return d, value + d * (gradient - 0.5 * d * curvature), bend


@triton.jit
def _step(terms, cells, moments, total, curvature, period, fall, max_chi2, state, out, padded_rows,
          padded_cols: tl.constexpr, RADIUS: tl.constexpr, FAR: tl.constexpr, SURFACES: tl.constexpr):
    i, j = tile_pixels(padded_rows)
    mine = record_of(state, i, tl.program_id(2), j, padded_cols, SURFACES)
    into = record_of(out, i, tl.program_id(2), j, padded_cols, SURFACES)
    seen = tl.load(mine + INTENSITY * padded_cols) > 0.0
    for field in tl.static_range(FIELDS):
        tl.store(into + field * padded_cols, tl.zeros([TILE], tl.float32), mask=~seen)
    if tl.max(seen.to(tl.int32), axis=0) == 0:
        return

    plane, before, steepness = plane_of(mine, padded_cols), tl.load(mine + STD * padded_cols), curvature / total
    point = plane, max_chi2 * before * before + TINY, max_chi2, period
    records, shown = record_of(state, i, 0, j, padded_cols, SURFACES), i * SURFACES * TERMS * padded_cols + j
    sums, bends, slope_col, slope_row = _pool(records, terms + shown, cells + shown, point, fall, steepness,
                                              padded_cols, RADIUS, FAR, SURFACES)
    value, gradient, bend, squares, photons, exposure = sums
    depth, old_col, old_row = plane
    bend_col, bend_row, off_plane = bends
    gradient -= (slope_col - old_col) * bend_col + (slope_row - old_row) * bend_row
    d, value, bend = _newton(value, gradient, bend, steepness)

    depth += d
    depth -= period * tl.floor(depth / period)
    strength = tl.maximum(value, 0.0) / total
    signal = tl.minimum(strength, photons)
    noise = (signal * tl.load(moments) + (photons - signal) * tl.load(moments + 1)) * squares
    std = tl.sqrt(noise / tl.maximum(photons, TINY)) / tl.maximum(signal * curvature, TINY)
    std = tl.where(signal > 0.0, tl.minimum(std, period), period)
    score = value / tl.sqrt(0.5 * squares * total + TINY)
    intensity = tl.maximum(strength / tl.maximum(exposure, TINY), TINY)
    store_surface(into, (depth, slope_col, slope_row), intensity, std, score, seen, padded_cols)
    gone = tl.maximum(before * before - std * std, 0.0)
    tl.store(into + RESIDUAL * padded_cols, tl.sqrt(tl.maximum(off_plane / bend - gone, 0.0)), mask=seen)


@triton.jit
def _coarsen(terms, period, max_chi2, state, cells, padded_rows, padded_cols: tl.constexpr, SURFACES: tl.constexpr):
    """The terms of the CELL × CELL pixels around each point, pooled along its plane."""
    i, j = tile_pixels(padded_rows)
    mine = record_of(state, i, tl.program_id(2), j, padded_cols, SURFACES)
    std = tl.load(mine + STD * padded_cols)
    point = plane_of(mine, padded_cols), max_chi2 * std * std + TINY, max_chi2, period
    records, shown = record_of(state, i, 0, j, padded_cols, SURFACES), i * SURFACES * TERMS * padded_cols + j
    sums, bends, planes = _no_sums()
    for dy in range(-(CELL // 2), CELL // 2 + 1):
        for dx in tl.range(-(CELL // 2), CELL // 2 + 1, loop_unroll_factor=max(CELL // SURFACES, 1)):
            sums, bends, planes = _add_neighbour(sums, bends, planes, records, terms + shown, point, 1.0, dy, dx,
                                                 padded_cols, SURFACES, False, False)
    seen = tl.load(mine + INTENSITY * padded_cols) > 0.0
    _store_terms(cells + shown + tl.program_id(2) * TERMS * padded_cols, sums, seen, padded_cols)


def pooled_step(frame, state, terms, sigma, radius, max_chi2, scratch=None, out=None):
    padded_rows, surfaces, _, padded_cols = state.shape
    out = torch.zeros_like(state) if out is None else out
    grid, sizes = (*tiles(padded_rows, padded_cols), surfaces), {"padded_cols": padded_cols, "SURFACES": surfaces}
    period, cells, far = float(frame.num_bins), terms, radius // CELL.value * CELL.value
    if far > FINE.value:
        cells = torch.zeros_like(terms)
        _coarsen[grid](terms, period, max_chi2, state, cells, padded_rows, **sizes, num_warps=TILE_ROWS)
    _step[grid](terms, cells, frame.moments, frame.total_energy, frame.curvature, period, fall_of(sigma), max_chi2,
                state, out, padded_rows, **sizes, RADIUS=radius, FAR=far, num_warps=TILE_ROWS)
    return out
