"""How a reconstruction's maps lie in memory, for all kernels.

Maps are padded with MARGIN empty pixels on every side, so that a window needs no bounds checks, and on the right up
to a whole number of BLOCKs. They are planar: [rows', …, cols'], the columns of one row and channel beside each other.

The state is one map [rows', K, FIELDS, cols'], K surfaces a pixel, with these fields:
"""

import math

import numpy as np

BLOCK = 32          # columns that are worked on together
MARGIN = 6          # pixels: the largest radius of a window

DEPTH = 0           # t, bins, in [0, T)
SLOPE_COL = 1       # tangent plane, bins per pixel to the right
SLOPE_ROW = 2       # and downwards
INTENSITY = 3       # r, expected signal photons; 0 = no surface
STD = 4             # standard deviation of the depth, bins
WINDOW = 5          # σ of the neighbourhood whose sketches the point pools, pixels
SCORE = 6           # evidence against "background alone", standard deviations
FIELDS = 7
ASTRAY = 0.125      # of T: a point with a larger standard deviation says nothing of the depth


def half_width(radius: int, line: int) -> int:
    """Pixels on each side of a round window's line, `line` rows from its middle: dx² + dy² ≤ radius · (radius + 1)."""
    return math.isqrt(radius * (radius + 1) - line * line)


def padded_shape(rows: int, cols: int) -> tuple[int, int]:
    """rows', cols' of an image."""
    return rows + 2 * MARGIN, -(-cols // BLOCK) * BLOCK + 2 * MARGIN


def pad(image: np.ndarray) -> np.ndarray:
    """float32 [rows, cols] or [rows, cols, C] → [rows', cols'] or [rows', C, cols']."""
    rows, cols = image.shape[:2]
    tall, wide = padded_shape(rows, cols)
    out = np.zeros((tall, *image.shape[2:], wide), np.float32)
    out[MARGIN:MARGIN + rows, ..., MARGIN:MARGIN + cols] = image if image.ndim == 2 else image.swapaxes(1, 2)
    return out


def crop(padded: np.ndarray, rows: int, cols: int) -> np.ndarray:
    """The view [rows, …, cols] of a padded map."""
    return padded[MARGIN:MARGIN + rows, ..., MARGIN:MARGIN + cols]


def state_shape(rows: int, cols: int, surfaces: int) -> tuple[int, int, int, int]:
    """rows', K, FIELDS, cols' of an image's state."""
    tall, wide = padded_shape(rows, cols)
    return tall, surfaces, FIELDS, wide


def no_surfaces(rows: int, cols: int, surfaces: int) -> np.ndarray:
    """A state without any surface, float32 [rows', K, FIELDS, cols']."""
    return np.zeros(state_shape(rows, cols, surfaces), np.float32)
