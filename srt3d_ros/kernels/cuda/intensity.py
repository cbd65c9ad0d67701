"""Intensity of every point from the photons of its own pixel."""

import triton
import triton.language as tl

from srt3d_ros.core import layout
from srt3d_ros.kernels.cuda.arithmetic import TINY, axis
from srt3d_ros.kernels.cuda.evidence import own_response
from srt3d_ros.kernels.cuda.layout import BLOCK, FIELDS, INTENSITY


@triton.jit
def _own_intensity(matched, exposure, energy, cycles, state, out, wide, m, SURFACES: tl.constexpr, M: tl.constexpr):
    i, j, l = tl.program_id(1), tl.program_id(0) * BLOCK + tl.arange(0, BLOCK), tl.arange(0, M)
    inside = j < wide
    total = tl.sum(tl.load(energy + l, mask=l < m, other=0.0))
    lit = tl.load(exposure + i * wide + j, mask=inside, other=0.0)
    for k in tl.static_range(SURFACES):
        response = own_response(matched, energy, cycles, lit, state, i, k, j, inside, wide, m, SURFACES, M)
        seen = tl.load(state + ((i * SURFACES + k) * FIELDS + INTENSITY) * wide + j, mask=inside, other=0.0) > 0.0
        share = response / (total * tl.maximum(lit, TINY))
        tl.store(out + (i * SURFACES + k) * wide + j, tl.where(seen, share, 0.0), mask=inside)


def own_intensity(data, state, out=None):
    """Least-squares intensity of each point from its own pixel alone, the pixel's other surfaces taken out.

    Args:
        data: the frame (see `srt3d_ros.core.frame.Frame`), padded.
        state: float32 [rows', K, FIELDS, cols'].
        out: where the result goes.

    Returns:
        float32 [rows', K, cols'], 0 where there is no point.
    """
    tall, surfaces, _, wide = state.shape
    out = state.new_empty(tall, surfaces, wide) if out is None else out
    m = len(data.energy)
    _own_intensity[(triton.cdiv(wide, layout.BLOCK), tall)](
        data.matched, data.exposure, data.energy, data.cycles, state, out, wide, m, SURFACES=surfaces, M=axis(m),
        num_warps=max(axis(m) // 16, 1))
    return out
