"""The indices of `maps` as unsigned integers, so that the compiler generates no wrap-around for negative indices."""

import numpy as np

from srt3d_ros.kernels import maps

U = np.uint64
B = U(maps.BLOCK)
DEPTH, SLOPE_COL, SLOPE_ROW, INTENSITY, STD, SCORE, RESIDUAL = (U(getattr(maps, name)) for name in (
    "DEPTH", "SLOPE_COL", "SLOPE_ROW", "INTENSITY", "STD", "SCORE", "RESIDUAL"))
VALUE, GRADIENT, CURVATURE, SQUARES, COUNTS, EXPOSURE, TERMS = (U(getattr(maps, name)) for name in (
    "VALUE", "GRADIENT", "CURVATURE", "SQUARES", "COUNTS", "EXPOSURE", "TERMS"))
