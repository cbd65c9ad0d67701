"""The layout's numbers as unsigned integers: of an index made of them the compiler knows that it counts from no end."""

import numpy as np

from srt3d_ros.kernels import layout

U = np.uint64
B = U(layout.BLOCK)
DEPTH, SLOPE_COL, SLOPE_ROW, INTENSITY, STD, SCORE, RESIDUAL = (U(getattr(layout, name)) for name in (
    "DEPTH", "SLOPE_COL", "SLOPE_ROW", "INTENSITY", "STD", "SCORE", "RESIDUAL"))
VALUE, GRADIENT, CURVATURE, SQUARES, COUNTS, EXPOSURE, TERMS = (U(getattr(layout, name)) for name in (
    "VALUE", "GRADIENT", "CURVATURE", "SQUARES", "COUNTS", "EXPOSURE", "TERMS"))
