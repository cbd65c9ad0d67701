"""What the other surfaces of a pixel leave of its sketch."""

import triton
import triton.language as tl

from srt3d_ros.kernels.cuda.arithmetic import TINY, axis, sincos
from srt3d_ros.kernels.cuda.evidence import own_response
from srt3d_ros.kernels.cuda.layout import BLOCK, DEPTH, FIELDS, INTENSITY
from srt3d_ros.kernels.cuda.scratch import borrow


@triton.jit
def _explain(matched, exposure, energy, cycles, m, wide, state, rest, SURFACES: tl.constexpr, M: tl.constexpr):
    i, tall = tl.program_id(1), tl.num_programs(1)
    j, l = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK), tl.arange(0, M)
    inside, known = j < wide, (l < m)[:, None] & (j < wide)[None, :]
    real = (i * 2 * m + l)[:, None] * wide + j[None, :]
    share = tl.load(energy + l, mask=l < m, other=0.0)[:, None]
    cycle = tl.load(cycles + l, mask=l < m, other=0.0)[:, None]
    lit = tl.load(exposure + i * wide + j, mask=inside, other=0.0)
    for k in tl.static_range(SURFACES):
        re = tl.load(matched + real, mask=known, other=0.0)
        im = tl.load(matched + real + m * wide, mask=known, other=0.0)
        for o in tl.static_range(SURFACES):
            if o != k:
                point = state + (i * SURFACES + o) * FIELDS * wide + j
                photons = tl.load(point + INTENSITY * wide, mask=inside, other=0.0) * lit
                sine, cosine = sincos(cycle * tl.load(point + DEPTH * wide, mask=inside, other=0.0)[None, :])
                re -= photons[None, :] * share * cosine
                im -= photons[None, :] * share * sine
        into = rest + k * tall * 2 * m * wide + real
        tl.store(into, re, mask=known)
        tl.store(into + m * wide, im, mask=known)


def explain(data, state, out=None):
    """What is left of the pixels' sketches for each of their surfaces when the others are taken out.

    Args:
        data: the frame (see `srt3d_ros.core.frame.Frame`), padded.
        state: float32 [rows', K, FIELDS, cols'].
        out: where the result goes, unless K = 1: then nothing is taken out.

    Returns:
        float32 [K, rows', 2m, cols'].
    """
    if state.shape[1] == 1:
        return data.matched[None]
    tall, surfaces, _, wide = state.shape
    out = data.matched.new_empty(surfaces, *data.matched.shape) if out is None else out
    m = len(data.energy)
    _explain[(triton.cdiv(wide, BLOCK.value), tall)](
        data.matched, data.exposure, data.energy, data.cycles, m, wide, state, out, SURFACES=surfaces, M=axis(m),
        num_warps=max(axis(m) // 16, 1))
    return out


@triton.jit
def _leave(matched, exposure, energy, cycles, m, wide, state, rest, LAYER: tl.constexpr, SURFACES: tl.constexpr,
           M: tl.constexpr):
    i, j, l = tl.program_id(1), tl.program_id(0) * BLOCK + tl.arange(0, BLOCK), tl.arange(0, M)
    inside, known = j < wide, (l < m)[:, None] & (j < wide)[None, :]
    real = (i * 2 * m + l)[:, None] * wide + j[None, :]
    share = tl.load(energy + l, mask=l < m, other=0.0)
    cycle, total = tl.load(cycles + l, mask=l < m, other=0.0)[:, None], tl.sum(share)
    lit = tl.load(exposure + i * wide + j, mask=inside, other=0.0)
    re = tl.load(matched + real, mask=known, other=0.0)
    im = tl.load(matched + real + m * wide, mask=known, other=0.0)
    for o in tl.static_range(SURFACES):
        if o != LAYER:
            point = state + (i * SURFACES + o) * FIELDS * wide + j
            there = tl.load(point + INTENSITY * wide, mask=inside, other=0.0) > 0.0
            own = own_response(matched, energy, cycles, lit, state, i, o, j, inside, wide, m, SURFACES, M)
            own = tl.maximum(own / (total * tl.maximum(lit, TINY)), 0.0)
            photons = tl.where(there, own * lit, 0.0)[None, :] * share[:, None]
            sine, cosine = sincos(cycle * tl.load(point + DEPTH * wide, mask=inside, other=0.0)[None, :])
            re -= photons * cosine
            im -= photons * sine
    tl.store(rest + real, re, mask=known)
    tl.store(rest + real + m * wide, im, mask=known)


def leave(data, state, layer, scratch=None):
    """What the surfaces before `layer` leave of the pixels' sketches, each as strong as its own pixel shows it.

    Why so strong is told in kernels/cpu/explain.py. A pixel's 8m bytes are read from memory and written once.

    Returns:
        float32 [rows', 2m, cols'].
    """
    tall, surfaces, _, wide = state.shape
    out, m = borrow(scratch, "left", data.matched.shape), len(data.energy)
    _leave[(triton.cdiv(wide, BLOCK.value), tall)](
        data.matched, data.exposure, data.energy, data.cycles, m, wide, state, out, LAYER=layer, SURFACES=surfaces,
        M=axis(m), num_warps=max(axis(m) // 16, 1))
    return out
