"""How much a pixel's own photons speak for its surfaces.

Per pixel and surface 8m + 16 bytes are read, 4 written, and a sine and a cosine of each frequency taken: at m = 10 and
a surface a pixel 100 bytes and some 350 operations, so that memory sets the pace.
"""

import triton
import triton.language as tl

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cuda.arithmetic import axis, sincos
from srt3d_ros.kernels.cuda.layout import BLOCK, DEPTH, FIELDS, INTENSITY

LIKENESS, SHARING, DEAD, LEFT = (tl.constexpr(getattr(constants, name)) for name in (
    "LIKENESS", "SHARING", "DEAD", "LEFT"))


@triton.jit
def nats(response, photons, expected, likeness, total, greatest, worth, moments, STEPS: tl.constexpr):
    """Log-likelihood gain of "a surface of about this intensity and background" over "background alone".

    The terms are those of `nats` in kernels/cpu/evidence.py. All must be finite, also where the result is not used: the
    response chooses an entry of `worth`.

    Args:
        response, photons, expected, likeness, total, greatest: as there.
        worth, moments: pointers to the Frame's rarity and intensity_moments.
        STEPS: entries of `worth`, less one.
    """
    dead = photons <= 0.0
    response, photons = tl.maximum(response, 0.0), tl.maximum(photons, 0.5)
    at = tl.minimum(response / (photons * greatest), 1.0) * STEPS
    low = tl.minimum(at.to(tl.int32), STEPS - 1)
    below, above = tl.load(worth + low), tl.load(worth + low + 1)
    rare = below + (at - low.to(tl.float32)) * (above - below)
    seen = response / total
    likely = tl.minimum(tl.maximum(seen, expected / likeness), expected * likeness)
    some = seen > 0.0
    deviance = likely - seen + tl.where(some, seen * tl.log(tl.where(some, seen / likely, 1.0)), 0.0)
    signal = likely * tl.load(moments)
    background = tl.maximum(photons - likely, 0.0) * tl.load(moments + 1)
    gain = 0.5 * photons * rare * rare - deviance * signal / (signal + background)
    return tl.where(dead, tl.maximum(gain, DEAD), gain)


@triton.jit
def own_response(matched, energy, cycles, exposure, state, i, k, j, inside, wide, m,
                 SURFACES: tl.constexpr, M: tl.constexpr):
    """Response of pixels (i, j) to the matched filters of their surfaces k, their other surfaces taken out.

    Args:
        matched, energy, cycles, state: pointers.
        exposure: float32 [BLOCK], of the pixels.
        i, k: the row, and the surface, known when compiling.
        j, inside: [BLOCK], columns, and which of them are in the map.
        wide, m: columns of the map, frequencies.
        M: m or the next power of two.
    """
    l = tl.arange(0, M)[:, None]
    cycle = tl.load(cycles + l, mask=l < m, other=0.0)
    at, there = matched + (i * 2 * m + l) * wide + j[None, :], (l < m) & inside[None, :]
    re, im = tl.load(at, mask=there, other=0.0), tl.load(at + m * wide, mask=there, other=0.0)
    records = state + i * SURFACES * FIELDS * wide + j
    depth = tl.load(records + (k * FIELDS + DEPTH) * wide, mask=inside, other=0.0)
    sine, cosine = sincos(cycle * depth[None, :])
    response = tl.sum(re * cosine + im * sine, axis=0)
    for o in tl.static_range(SURFACES):
        if o != k:
            other = tl.load(records + (o * FIELDS + DEPTH) * wide, mask=inside, other=0.0)
            known = tl.load(records + (o * FIELDS + INTENSITY) * wide, mask=inside, other=0.0) * exposure
            _, apart = sincos(cycle * (other - depth)[None, :])
            response -= known * tl.sum(tl.load(energy + l, mask=l < m, other=0.0) * apart, axis=0)
    return response


@triton.jit
def _evidence(matched, noise, exposure, energy, cycles, greatest, worth, moments, state, out, wide, m,
              STEPS: tl.constexpr, SURFACES: tl.constexpr, M: tl.constexpr, BLOCK: tl.constexpr):
    i, j = tl.program_id(1), tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    inside = j < wide
    seen = tl.load(exposure + i * wide + j, mask=inside, other=0.0)
    photons = tl.load(noise + i * wide + j, mask=inside, other=0.0)
    l = tl.arange(0, M)
    total = tl.sum(tl.load(energy + l, mask=l < m, other=0.0), axis=0)
    records = state + i * SURFACES * FIELDS * wide + j
    for k in tl.static_range(SURFACES):
        response = own_response(matched, energy, cycles, seen, state, i, k, j, inside, wide, m, SURFACES, M)
        expected = tl.load(records + (k * FIELDS + INTENSITY) * wide, mask=inside, other=0.0) * seen
        others = tl.zeros_like(expected)
        for o in tl.static_range(SURFACES):
            if o != k:
                others += tl.load(records + (o * FIELDS + INTENSITY) * wide, mask=inside, other=0.0) * seen
        left = tl.where(photons > 0.0, tl.maximum(photons - others, LEFT), 0.0)
        there = expected > 0.0
        gain = nats(response, left, tl.where(there, expected, 1.0), tl.where(others > 0.0, SHARING, LIKENESS), total,
                    greatest, worth, moments, STEPS)
        tl.store(out + (i * SURFACES + k) * wide + j, tl.where(there, gain, 0.0), mask=inside)


def evidence(data, state, out=None):
    """Log-likelihood gain of every point by its own pixel's photons, nats.

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
    _evidence[triton.cdiv(wide, BLOCK.value), tall](
        data.matched, data.noise, data.exposure, data.energy, data.cycles, data.greatest_response, data.rarity,
        data.intensity_moments, state, out, wide, m, STEPS=len(data.rarity) - 1, SURFACES=surfaces, M=axis(m),
        BLOCK=BLOCK, num_warps=max(axis(m) // 16, 1))
    return out
