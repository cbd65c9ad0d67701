"""One iteration's gradient steps: measure every point's tangent plane, pool the sketches along it, climb.

A thread owns a point and up to 16 of its frequencies; what it adds up stays in registers. The 8m bytes of a pixel are
read from the caches by every window that it lies in. With m = 10 and the radius 6 a warp executes some 31,000
instructions for its 32 points, of which 4/5 pool, at 171 for each of the 145 steps through the window, while it takes
5 kB from memory: arithmetic sets the pace. A third more would go into addresses if the compiler did not know the maps'
width. (Counted in the machine code for compute capability 9.0; nobody has timed it.)
"""

import torch
import triton
import triton.language as tl

from srt3d_ros.core import layout
from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cuda.arithmetic import LOG2E, TINY, TURN, axis, sincos
from srt3d_ros.kernels.cuda.explain import explain
from srt3d_ros.kernels.cuda.layout import (
    BLOCK,
    DEPTH,
    FIELDS,
    INTENSITY,
    MARGIN,
    SCORE,
    SLOPE_COL,
    SLOPE_ROW,
    STD,
    WINDOW,
)
from srt3d_ros.kernels.cuda.pool import fit, pool

FITS = tl.constexpr(constants.FITS)


@triton.jit
def _climb(re, im, cycle, total, curvature, steps):
    """Gradient steps on Σ_l Re((re + i im)_l exp(−i ω_l d)), each divided by the curvature there.

    A step ends at the width of a peak: where the photons contradict the point the curvature says nothing.

    Returns:
        d and the sum there.
    """
    omega, reach = cycle * TURN, tl.sqrt(total / curvature)
    d = tl.zeros([BLOCK], tl.float32)
    value = tl.zeros([BLOCK], tl.float32)
    for step in range(steps + 1):
        sine, cosine = sincos(cycle * d[None, :])
        along = re * cosine + im * sine
        value = tl.sum(along, axis=0)
        if step < steps:
            slope = tl.sum(omega * (im * cosine - re * sine), axis=0)
            bend = tl.maximum(tl.sum(omega * omega * along, axis=0), 0.5 * tl.maximum(value, 0.0) / total * curvature)
            d += tl.minimum(tl.maximum(slope / (bend + TINY), -reach), reach)
    return d, value


@triton.jit
def _descend(sketches, noise, exposure, energy, cycles, moments, period, gate, steps, state, out, m: tl.constexpr,
             wide: tl.constexpr, RADIUS: tl.constexpr, FIT: tl.constexpr, WIDTH: tl.constexpr, SURFACES: tl.constexpr,
             M: tl.constexpr):
    i, tall = tl.program_id(1) + MARGIN, tl.num_programs(1) + 2 * MARGIN
    j, l = tl.program_id(0) * BLOCK + MARGIN + tl.arange(0, BLOCK), tl.arange(0, M)
    points = i * SURFACES * FIELDS * wide + j
    mine = points + tl.program_id(2) * FIELDS * wide
    seen = tl.load(state + mine + INTENSITY * wide) > 0.0
    if tl.max(seen.to(tl.int32), axis=0) == 0:
        for field in tl.static_range(FIELDS):
            tl.store(out + mine + field * wide, tl.zeros([BLOCK], tl.float32))
        return

    share = tl.load(energy + l, mask=l < m, other=0.0)
    cycle = tl.load(cycles + l, mask=l < m, other=0.0)
    total, curvature = tl.sum(share), tl.sum(share * cycle * cycle) * (TURN * TURN)
    t = tl.load(state + mine + DEPTH * wide)
    sc, sr = tl.load(state + mine + SLOPE_COL * wide), tl.load(state + mine + SLOPE_ROW * wide)
    std, window = tl.load(state + mine + STD * wide), tl.load(state + mine + WINDOW * wide)
    variance, h = gate * std * std + TINY, tl.maximum(window, 0.1)
    fall = (-0.5 / (h * h)) * LOG2E

    for _ in tl.static_range(FITS):
        sc, sr = fit(state + points, wide, t, sc, sr, variance, fall, gate, period, curvature / total, FIT, WIDTH,
                     SURFACES)
    pixel, real = i * wide + j, (i * 2 * m + l)[:, None] * wide + j[None, :]
    re, im, squares, photons, exposures = pool(
        state + points, sketches + real, noise + pixel, exposure + pixel, wide, m, tall * 2 * m * wide,
        (l < m)[:, None], cycle[:, None], t, sc, sr, variance, fall, gate, period, RADIUS, SURFACES)
    d, value = _climb(re, im, cycle[:, None], total, curvature, steps)

    t += d
    strength = tl.maximum(value, 0.0) / total
    signal = tl.minimum(strength, photons)
    spread = signal * tl.load(moments) + (photons - signal) * tl.load(moments + 1)
    spread *= squares / tl.maximum(photons, TINY)
    std = tl.minimum(tl.sqrt(spread) / tl.maximum(signal * curvature, TINY), period)
    score = value / tl.sqrt(0.5 * squares * total + TINY)
    # A point found in a wider window than this one keeps the evidence that was found there.
    score = tl.where(1.5 * window > RADIUS, tl.maximum(score, tl.load(state + mine + SCORE * wide)), score)
    intensity = tl.maximum(strength / tl.maximum(exposures, TINY), TINY)
    out += mine
    tl.store(out + DEPTH * wide, tl.where(seen, t - period * tl.floor(t / period), 0.0))
    tl.store(out + SLOPE_COL * wide, tl.where(seen, sc, 0.0))
    tl.store(out + SLOPE_ROW * wide, tl.where(seen, sr, 0.0))
    tl.store(out + INTENSITY * wide, tl.where(seen, intensity, 0.0))
    tl.store(out + STD * wide, tl.where(seen, tl.where(signal > 0.0, std, period), 0.0))
    tl.store(out + WINDOW * wide, tl.where(seen, window, 0.0))
    tl.store(out + SCORE * wide, tl.where(seen, score, 0.0))


def descend(data, state, radius, gate, steps=3, out=None):
    """Gradient steps of every point on the sketches pooled around it.

    Args:
        data: the frame (see `srt3d_ros.core.frame.Frame`), padded.
        state: float32 [rows', K, FIELDS, cols'].
        radius: of the round window, pixels, at most MARGIN.
        gate: square of the number of standard deviations within which depths may belong to one surface.
        steps: gradient steps.
        out: where the result goes; its margins are left as they are.

    Returns:
        The next state: depth, slopes, intensity (of the pool, per pixel), std and score.
    """
    tall, surfaces, _, wide = state.shape
    sketches = explain(data, state)
    out = torch.zeros_like(state) if out is None else out
    m, near = len(data.energy), min(radius, constants.FIT_RADIUS)
    _descend[((wide - 2 * layout.MARGIN) // layout.BLOCK, tall - 2 * layout.MARGIN, surfaces)](
        sketches, data.noise, data.exposure, data.energy, data.cycles, data.moments, float(data.num_bins), gate, steps,
        state, out, m=m, wide=wide, RADIUS=radius, FIT=near, WIDTH=triton.next_power_of_2(2 * near + 1),
        SURFACES=surfaces, M=axis(m), num_warps=max(axis(m) // 16, 1))
    return out
