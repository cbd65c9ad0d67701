"""Gradient steps of every point on its own pixel's sketch.

Per pixel 8m + 8 bytes are read, 8 read and 8 written for each surface, and twice a sine and a cosine of each frequency
taken: at m = 10 and a surface a pixel 104 bytes and some 900 operations.
"""

import triton
import triton.language as tl

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cuda.arithmetic import TINY, TURN, axis, sincos
from srt3d_ros.kernels.cuda.maps import BLOCK

RATE = tl.constexpr(constants.INTENSITY_RATE)


@triton.jit
def _pixelwise(matched, counts, exposure, energy, bin_frequencies, period, table, rate, usual, depth, intensity, cols,
               m, LEVELS: tl.constexpr, SURFACES: tl.constexpr, M: tl.constexpr, BLOCK: tl.constexpr):
    i, j = tl.program_id(1), tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    inside, l = j < cols, tl.arange(0, M)[:, None]
    seen = tl.load(exposure + i * cols + j, mask=inside, other=0.0)
    photons = tl.maximum(tl.load(counts + i * cols + j, mask=inside, other=0.0), 1.0)
    frequency, e = tl.load(bin_frequencies + l, mask=l < m, other=0.0), tl.load(energy + l, mask=l < m, other=0.0)
    omega = frequency * TURN
    reach = tl.sqrt(tl.sum(e) / tl.sum(e * omega * omega))
    at, there = matched + (i * 2 * m + l) * cols + j[None, :], (l < m) & inside[None, :]
    re, im = tl.load(at, mask=there, other=0.0), tl.load(at + m * cols, mask=there, other=0.0)
    for k in tl.static_range(SURFACES):
        place = (i * SURFACES + k) * cols + j
        sine, cosine = sincos(frequency * tl.load(depth + place, mask=inside, other=0.0)[None, :])
        explained = e * (seen * tl.load(intensity + place, mask=inside, other=0.0))[None, :]
        re, im = re - explained * cosine, im - explained * sine
    for k in tl.static_range(SURFACES):
        place = (i * SURFACES + k) * cols + j
        t, r = tl.load(depth + place, mask=inside, other=0.0), tl.load(intensity + place, mask=inside, other=0.0)
        level = (tl.minimum(seen * r / photons, 1.0) * (LEVELS - 1) + 0.5).to(tl.int32)
        weights = table + level[None, :] * 4 * m + l
        sine, cosine = sincos(frequency * t[None, :])
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


def pixelwise(frame, table, rate, usual, depth, intensity):
    """A program per BLOCK pixels of a row."""
    rows, surfaces, cols = depth.shape
    m = len(frame.energy)
    _pixelwise[triton.cdiv(cols, BLOCK.value), rows](
        frame.matched, frame.counts, frame.exposure, frame.energy, frame.bin_frequencies, float(frame.num_bins), table,
        float(rate), float(usual), depth, intensity, cols, m, LEVELS=len(table), SURFACES=surfaces, M=axis(m),
        BLOCK=BLOCK, num_warps=max(axis(m) // 16, 1))
