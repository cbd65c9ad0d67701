"""Maps and surfaces as the CUDA kernels read them. Triton takes no globals but `tl.constexpr`."""

import triton
import triton.language as tl

from srt3d_ros.kernels import maps

BLOCK = tl.constexpr(maps.BLOCK)      # columns of a program: a warp's width, so that a thread owns a pixel
MARGIN, MAX_STD = tl.constexpr(maps.MARGIN), tl.constexpr(maps.MAX_STD)
DEPTH, SLOPE_COL, SLOPE_ROW, INTENSITY, STD, SCORE, RESIDUAL, FIELDS = (
    tl.constexpr(getattr(maps, name)) for name in (
        "DEPTH", "SLOPE_COL", "SLOPE_ROW", "INTENSITY", "STD", "SCORE", "RESIDUAL", "FIELDS"))
VALUE, GRADIENT, CURVATURE, SQUARES, COUNTS, EXPOSURE, TERMS = (tl.constexpr(getattr(maps, name)) for name in (
    "VALUE", "GRADIENT", "CURVATURE", "SQUARES", "COUNTS", "EXPOSURE", "TERMS"))

TILE_ROWS = 4                           # rows of a tile, a warp each: they share the cache lines of their windows
TILE = tl.constexpr(TILE_ROWS * maps.BLOCK)


def tiles(padded_rows: int, padded_cols: int) -> tuple[int, int]:
    """Programs across and down, of TILE pixels each, for the image of a padded map."""
    return (padded_cols - 2 * maps.MARGIN) // maps.BLOCK, triton.cdiv(padded_rows - 2 * maps.MARGIN, TILE_ROWS)


@triton.jit
def tile_pixels(padded_rows):
    """Rows and columns [TILE] of a program's pixels in the padded maps.

    Rows beyond the image are its last one: what they write is written twice, the same.
    """
    pixel = tl.arange(0, TILE)
    i = MARGIN + tl.program_id(1) * (TILE // BLOCK) + pixel // BLOCK
    j = MARGIN + tl.program_id(0) * BLOCK + pixel % BLOCK
    return tl.minimum(i, padded_rows - MARGIN - 1), j


@triton.jit
def record_of(state, i, k, j, padded_cols, SURFACES: tl.constexpr):
    """Pointers to the first field of surfaces k of pixels (i, j)."""
    return state + (i * SURFACES + k) * FIELDS * padded_cols + j


@triton.jit
def store_surface(record, plane, intensity, std, score, mask, padded_cols):
    """Write surfaces, all fields but RESIDUAL; `plane` as of `plane_of`."""
    depth, slope_col, slope_row = plane
    tl.store(record + DEPTH * padded_cols, depth, mask=mask)
    tl.store(record + SLOPE_COL * padded_cols, slope_col, mask=mask)
    tl.store(record + SLOPE_ROW * padded_cols, slope_row, mask=mask)
    tl.store(record + INTENSITY * padded_cols, intensity, mask=mask)
    tl.store(record + STD * padded_cols, std, mask=mask)
    tl.store(record + SCORE * padded_cols, score, mask=mask)


@triton.jit
def has_depth(record, padded_cols, period):
    """Whether there is a surface, at a depth that means anything."""
    return (tl.load(record + INTENSITY * padded_cols) > 0.0) & (tl.load(record + STD * padded_cols) < period * MAX_STD)


@triton.jit
def surface_count(state, i, j, padded_cols, period, SURFACES: tl.constexpr):
    """How many surfaces pixels (i, j) have."""
    count = j - j
    for k in tl.static_range(SURFACES):
        count += has_depth(record_of(state, i, k, j, padded_cols, SURFACES), padded_cols, period).to(tl.int32)
    return count


@triton.jit
def plane_of(record, padded_cols):
    """Depths of surfaces, and their slopes to the right and downwards."""
    return (tl.load(record + DEPTH * padded_cols), tl.load(record + SLOPE_COL * padded_cols),
            tl.load(record + SLOPE_ROW * padded_cols))


@triton.jit
def plane_depth(plane, dy, dx):
    """Depths of tangent planes, of `plane_of`, (dy, dx) pixels from their surfaces."""
    depth, slope_col, slope_row = plane
    return depth + slope_row * dy + slope_col * dx


@triton.jit
def carried(record, dy, dx, max_chi2, blur2, padded_cols):
    """Depths of surfaces, carried back by (dy, dx) pixels along their planes, and what they may be off, squared."""
    std = tl.load(record + STD * padded_cols)
    return plane_depth(plane_of(record, padded_cols), -dy, -dx), max_chi2 * (std * std) + blur2
