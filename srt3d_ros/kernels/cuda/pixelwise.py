"""Gradient steps of every point on its own pixel's sketch.

Per pixel 8m + 8 bytes are read, 8 read and 8 written for each surface, and twice a sine and a cosine of each frequency
taken: at m = 10 and a surface a pixel 104 bytes and some 900 operations.
"""

import triton
import triton.language as tl

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cuda.arithmetic import TINY, TURN, axis, sincos
from srt3d_ros.kernels.cuda.layout import BLOCK

RATE = tl.constexpr(constants.INTENSITY_RATE)


@triton.jit
def _pixelwise(matched, noise, exposure, energy, cycles, period, table, rate, usual, depth, intensity, cols, m,
               LEVELS: tl.constexpr, SURFACES: tl.constexpr, M: tl.constexpr, BLOCK: tl.constexpr):
    i, j = tl.program_id(1), tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    inside, l = j < cols, tl.arange(0, M)[:, None]
    seen = tl.load(exposure + i * cols + j, mask=inside, other=0.0)
    photons = tl.maximum(tl.load(noise + i * cols + j, mask=inside, other=0.0), 1.0)
    cycle, e = tl.load(cycles + l, mask=l < m, other=0.0), tl.load(energy + l, mask=l < m, other=0.0)
    omega = cycle * TURN
    reach = tl.sqrt(tl.sum(e) / tl.sum(e * omega * omega))
    at, there = matched + (i * 2 * m + l) * cols + j[None, :], (l < m) & inside[None, :]
    re, im = tl.load(at, mask=there, other=0.0), tl.load(at + m * cols, mask=there, other=0.0)
    for k in tl.static_range(SURFACES):
        place = (i * SURFACES + k) * cols + j
        sine, cosine = sincos(cycle * tl.load(depth + place, mask=inside, other=0.0)[None, :])
        explained = e * (seen * tl.load(intensity + place, mask=inside, other=0.0))[None, :]
        re, im = re - explained * cosine, im - explained * sine
    for k in tl.static_range(SURFACES):
        place = (i * SURFACES + k) * cols + j
        t, r = tl.load(depth + place, mask=inside, other=0.0), tl.load(intensity + place, mask=inside, other=0.0)
        level = (tl.minimum(seen * r / photons, 1.0) * (LEVELS - 1) + 0.5).to(tl.int32)
        weights = table + level[None, :] * 4 * m + l
        sine, cosine = sincos(cycle * t[None, :])
        along, across = re * cosine + im * sine, im * cosine - re * sine
        shift = tl.sum(tl.load(weights, mask=l < m, other=0.0) * along
                       + tl.load(weights + m, mask=l < m, other=0.0) * across, axis=0)
        change = tl.sum(tl.load(weights + 2 * m, mask=l < m, other=0.0) * along
                        + tl.load(weights + 3 * m, mask=l < m, other=0.0) * across, axis=0)
        gain = tl.maximum(seen, TINY)
        grown = r + change * RATE / gain
        signal = tl.maximum(r, grown) * gain
        least = tl.maximum(signal, usual * gain)
        move = rate * shift * signal / (least * least + TINY)
        t += tl.minimum(tl.maximum(move, -reach), reach)
        tl.store(depth + place, t - period * tl.floor(t / period), mask=inside & (r > 0.0))
        tl.store(intensity + place, tl.maximum(grown, 0.0), mask=inside & (r > 0.0))


def pixelwise(data, table, rate, usual, depth, intensity):
    """One gradient step in depth and intensity on n (z − Ψ_θ)ᵀ W (z − Ψ_θ), in place.

    The step is told in kernels/cpu/pixelwise.py.

    Args:
        data: the frame (see `srt3d_ros.core.frame.Frame`), not padded.
        table: float32 [levels, 4, m], weights of Re d and Im d for depth, then for intensity, for shares of signal
            from 0 to 1 of the pixel's photons.
        rate: of the full step, for depths.
        usual: intensity below which points move less than their curvature allows; 0 for none.
        depth, intensity: float32 [rows, K, cols]; 0 = no point. Changed in place.
    """
    rows, surfaces, cols = depth.shape
    m = len(data.energy)
    _pixelwise[triton.cdiv(cols, BLOCK.value), rows](
        data.matched, data.noise, data.exposure, data.energy, data.cycles, float(data.num_bins), table, float(rate),
        float(usual), depth, intensity, cols, m, LEVELS=len(table), SURFACES=surfaces, M=axis(m), BLOCK=BLOCK,
        num_warps=max(axis(m) // 16, 1))
