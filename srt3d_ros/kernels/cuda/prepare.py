"""A sketch as the iterations want it: matched to the IRF, one plane for each part of each frequency, with margins."""

import torch
import triton
import triton.language as tl

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.cuda.arithmetic import axis
from srt3d_ros.kernels.cuda.maps import BLOCK, MARGIN
from srt3d_ros.kernels.cuda.scratch import borrow


@triton.jit
def _prepare(sums, photons, equaliser, used, matched, counts, rows, cols, padded_cols, m, by_row, by_col,
             M: tl.constexpr):
    i, j, l = tl.program_id(1), tl.program_id(0) * BLOCK + tl.arange(0, BLOCK), tl.arange(0, M)[None, :]
    row, col = i - MARGIN, j - MARGIN
    inside = (col >= 0) & (col < tl.where((row >= 0) & (row < rows), cols, 0))
    seen, at = inside[:, None] & (l < m), (row * cols + col)[:, None] * (2 * m) + 2 * l
    re, im = tl.load(sums + at, mask=seen, other=0.0), tl.load(sums + at + 1, mask=seen, other=0.0)
    by = (row * by_row + col * by_col)[:, None] * (2 * m) + 2 * l
    c, d = tl.load(equaliser + by, mask=seen, other=0.0), tl.load(equaliser + by + 1, mask=seen, other=0.0)
    into, there = matched + (i * 2 * m + l) * padded_cols + j[:, None], (j < padded_cols)[:, None] & (l < m)
    tl.store(into, re * c - im * d, mask=there)
    tl.store(into + m * padded_cols, re * d + im * c, mask=there)
    count = tl.load(photons + row * cols + col, mask=inside, other=0).to(tl.float32)
    count *= tl.load(used + row * cols + col, mask=inside, other=0.0)
    tl.store(counts + i * padded_cols + j, count, mask=j < padded_cols)


def prepare(sums, photons, equaliser, used, scratch=None):
    """A pixel's 8m + 8 bytes are read and 8m + 4 written once, margins with them."""
    rows, cols, m = sums.shape
    padded_rows, padded_cols = maps.padded_shape(rows, cols)
    matched = borrow(scratch, "matched", (padded_rows, 2 * m, padded_cols))
    counts = borrow(scratch, "counts", (padded_rows, padded_cols))
    by_row, by_col = (equaliser.shape[1] if equaliser.shape[0] > 1 else 0), int(equaliser.shape[1] > 1)
    _prepare[(triton.cdiv(padded_cols, maps.BLOCK), padded_rows)](
        torch.view_as_real(sums.contiguous()), photons.contiguous(), torch.view_as_real(equaliser), used, matched,
        counts, rows, cols, padded_cols, m, by_row, by_col, M=axis(m), num_warps=max(axis(m) // 16, 1))
    return matched, counts
