"""The layout in memory of a reconstruction's maps, for all kernels.

Maps are padded with MARGIN empty pixels on every side, so that a window needs no bounds checks, and on the right up
to whole vectors of LANES pixels. They are planar: [rows', …, cols'], the columns of one row and channel beside each
other.

The state is one map [rows', K, FIELDS, cols']: K surfaces a pixel, with the fields DEPTH … RESIDUAL.
"""

import math
from functools import lru_cache

import numpy as np

MARGIN = 16         # pixels: the largest radius of a window

# ---- Sizes that processors decide

LANES = 16          # numbers of a vector: columns worked on together, a cache line
ROW_LANES = 24      # int32 values of a part of a sketching row: three registers, enough for m = 11 and the photons
UNIT = 2**23        # what counts as 1 in a sketching row: rounded to 2⁻²⁴, as float32 is
MAX_ROWS = 255      # rows whose sum surely fits into 32 bits: below 2³¹ / UNIT

# ---- Fields of states and terms

DEPTH = 0           # t, bins, in [0, T)
SLOPE_COL = 1       # tangent plane, bins per pixel to the right
SLOPE_ROW = 2       # and downwards
INTENSITY = 3       # r, expected signal photons; 0 = no surface
STD = 4             # standard deviation of the depth, bins
SCORE = 5           # evidence against "background alone", standard deviations
RESIDUAL = 6        # what the plane adds to the depth's standard deviation: its noise, and relief beside it, bins
FIELDS = 7

VALUE = 0           # v, the data term of a pixel's photons at the depth of its surface
GRADIENT = 1        # s, its slope there, per bin
CURVATURE = 2       # b, its curvature, per bin²
SQUARES = 3         # Σ w² n
COUNTS = 4          # Σ w n
EXPOSURE = 5        # Σ w g
TERMS = 6
MAX_STD = 0.125     # of T; a point with a larger standard deviation has no known depth


def padded_shape(rows: int, cols: int) -> tuple[int, int]:
    """rows', cols' of an image."""
    return rows + 2 * MARGIN, -(-cols // LANES) * LANES + 2 * MARGIN


def pad(image: np.ndarray) -> np.ndarray:
    """float32 [rows, cols] or [rows, cols, C] → [rows', cols'] or [rows', C, cols']."""
    rows, cols = image.shape[:2]
    padded_rows, padded_cols = padded_shape(rows, cols)
    out = np.zeros((padded_rows, *image.shape[2:], padded_cols), np.float32)
    out[MARGIN:MARGIN + rows, ..., MARGIN:MARGIN + cols] = image if image.ndim == 2 else image.swapaxes(1, 2)
    return out


def crop(padded: np.ndarray, rows: int, cols: int) -> np.ndarray:
    """The view [rows, …, cols] of a padded map."""
    return padded[MARGIN:MARGIN + rows, ..., MARGIN:MARGIN + cols]


def state_shape(rows: int, cols: int, surfaces: int) -> tuple[int, int, int, int]:
    """rows', K, FIELDS, cols' of an image's state."""
    padded_rows, padded_cols = padded_shape(rows, cols)
    return padded_rows, surfaces, FIELDS, padded_cols


@lru_cache
def window_weights(sigma: float) -> np.ndarray:
    """exp(−d² / 2σ²) for d = −⌈2.5 σ⌉ … ⌈2.5 σ⌉: a Gaussian over rows or columns of pixels or cells; float32."""
    radius = math.ceil(2.5 * sigma)
    return np.exp(-np.arange(-radius, radius + 1)**2 / (2 * sigma**2)).astype(np.float32)
