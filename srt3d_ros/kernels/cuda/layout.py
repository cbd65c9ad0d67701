"""`srt3d_ros.core.layout`'s numbers as the CUDA kernels read them: Triton takes no globals but `tl.constexpr`."""

import triton.language as tl

from srt3d_ros.core import layout

BLOCK = tl.constexpr(layout.BLOCK)      # columns of a program: a warp's width, so that a thread owns a pixel
MARGIN = tl.constexpr(layout.MARGIN)
DEPTH, SLOPE_COL, SLOPE_ROW, INTENSITY, STD, WINDOW, SCORE, FIELDS = (tl.constexpr(getattr(layout, name)) for name in (
    "DEPTH", "SLOPE_COL", "SLOPE_ROW", "INTENSITY", "STD", "WINDOW", "SCORE", "FIELDS"))
