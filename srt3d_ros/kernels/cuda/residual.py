"""What the other surfaces of a pixel leave of its sketch."""

import triton
import triton.language as tl

from srt3d_ros.kernels.cuda.arithmetic import axis, sincos
from srt3d_ros.kernels.cuda.maps import BLOCK, DEPTH, TERMS, VALUE
from srt3d_ros.kernels.cuda.scratch import borrow
from srt3d_ros.kernels.cuda.surfaces import record_of


@triton.jit
def _residual(matched, energy, bin_frequencies, total, m, padded_cols, state, terms, rest, LAYER: tl.constexpr,
              SURFACES: tl.constexpr, M: tl.constexpr):
    i, j, l = tl.program_id(1), tl.program_id(0) * BLOCK + tl.arange(0, BLOCK), tl.arange(0, M)
    inside, known = j < padded_cols, (l < m)[:, None] & (j < padded_cols)[None, :]
    real = (i * 2 * m + l)[:, None] * padded_cols + j[None, :]
    share = tl.load(energy + l, mask=l < m, other=0.0)[:, None]
    frequency = tl.load(bin_frequencies + l, mask=l < m, other=0.0)[:, None]
    re = tl.load(matched + real, mask=known, other=0.0)
    im = tl.load(matched + real + m * padded_cols, mask=known, other=0.0)
    for k in tl.static_range(SURFACES):
        if k != LAYER:
            value = tl.load(terms + ((i * SURFACES + k) * TERMS + VALUE) * padded_cols + j, mask=inside, other=0.0)
            record = record_of(state, i, k, j, padded_cols, SURFACES)
            depth = tl.load(record + DEPTH * padded_cols, mask=inside, other=0.0)
            sine, cosine = sincos(frequency * depth[None, :])
            photons = (tl.maximum(value, 0.0) / total)[None, :]
            re -= photons * share * cosine
            im -= photons * share * sine
    tl.store(rest + real, re, mask=known)
    tl.store(rest + real + m * padded_cols, im, mask=known)


def residual(frame, state, terms, layer, scratch=None):
    """A pixel's 8m bytes are read and written once, by a program per BLOCK pixels of a row."""
    padded_rows, surfaces, _, padded_cols = state.shape
    out, m = borrow(scratch, "residual", frame.matched.shape), len(frame.energy)
    _residual[triton.cdiv(padded_cols, BLOCK.value), padded_rows](
        frame.matched, frame.energy, frame.bin_frequencies, frame.total_energy, m, padded_cols, state, terms, out,
        LAYER=layer, SURFACES=surfaces, M=axis(m), num_warps=max(axis(m) // 16, 1))
    return out
