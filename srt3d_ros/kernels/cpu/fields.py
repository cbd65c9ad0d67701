"""The layout's numbers as unsigned integers: of an index made of them the compiler knows that it counts from no end."""

import numpy as np

from srt3d_ros.core import layout

U = np.uint64
B = U(layout.BLOCK)
DEPTH, SLOPE_COL, SLOPE_ROW, INTENSITY, STD, WINDOW, SCORE = (U(getattr(layout, name)) for name in (
    "DEPTH", "SLOPE_COL", "SLOPE_ROW", "INTENSITY", "STD", "WINDOW", "SCORE"))
