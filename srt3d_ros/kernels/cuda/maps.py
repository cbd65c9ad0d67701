"""`srt3d_ros.kernels.maps`'s numbers as the CUDA kernels read them: Triton takes no globals but `tl.constexpr`."""

import triton
import triton.language as tl

from srt3d_ros.kernels import maps

BLOCK = tl.constexpr(maps.BLOCK)      # columns of a program: a warp's width, so that a thread owns a pixel
MARGIN = tl.constexpr(maps.MARGIN)
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
