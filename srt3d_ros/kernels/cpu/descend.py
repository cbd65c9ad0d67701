"""One iteration's gradient steps: measure every point's tangent plane, pool the sketches along it, climb.

`pool` does what is to be done for a line of a window; here is the order in which a block of points goes through them.
"""

import numpy as np
from numba import prange

from srt3d_ros.core import layout
from srt3d_ros.core.layout import BLOCK, FIELDS, MARGIN
from srt3d_ros.kernels.constants import FIT_RADIUS, FITS, RIDGE
from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, ONE, TINY, ZERO, aligned, sincos, total_of
from srt3d_ros.kernels.cpu.compiling import inline, parallel
from srt3d_ros.kernels.cpu.explain import explain
from srt3d_ros.kernels.cpu.fields import DEPTH, INTENSITY, SCORE, SLOPE_COL, SLOPE_ROW, STD, WINDOW, B, U
from srt3d_ros.kernels.cpu.pool import (
    BASE,
    BEND,
    CLOSE,
    COL,
    EXPOSURE,
    F0,
    FE,
    FX,
    FXE,
    FXX,
    FXY,
    FY,
    FYE,
    FYY,
    GROUP,
    HALF_IM,
    HALF_RE,
    IM,
    LINE_0,
    LINE_1,
    LINE_2,
    LINE_3,
    LINE_4,
    LINE_5,
    LINE_6,
    NEAR,
    NOISE,
    PHOTONS,
    RE,
    ROW,
    SC,
    SCRATCH,
    SLOPE,
    SR,
    VALUE,
    VARIANCE,
    D,
    T,
    W,
    fit_line,
    pool_line,
)


@inline
def _begin(s, state, point, wide, radius, gate):
    """Load the points of a block and set the weights of their windows by distance."""
    for x in range(B):
        s[T + x] = state[point + DEPTH * wide + x]
        s[SC + x] = state[point + SLOPE_COL * wide + x]
        s[SR + x] = state[point + SLOPE_ROW * wide + x]
        std, h = state[point + STD * wide + x], max(state[point + WINDOW * wide + x], F32(0.1))
        s[VARIANCE + x] = gate * std * std + TINY
        s[W + x] = -HALF / (h * h)
        s[NEAR + x] = ONE
    for x in range(B):
        s[W + x] = np.exp(s[W + x])
        s[CLOSE + x] = s[W + x]
    for d in range(U(1), U(radius) + U(1)):         # near[d] = w^(d²) = near[d − 1] · w^(2d − 1)
        for x in range(B):
            s[NEAR + d * B + x] = s[NEAR + d * B - B + x] * s[CLOSE + x]
            s[CLOSE + x] *= s[W + x] * s[W + x]


@inline
def _fit(s, state, i, j, wide, surfaces, radius, gate, period):
    """Sums of the planes through the surfaces around pixel (i, j) and the columns after it."""
    for x in range(BASE - F0):
        s[F0 + x] = ZERO
    for dy in range(-radius, radius + 1):
        at = U((i + dy) * surfaces * FIELDS * wide + j - radius)
        for q in range(surfaces):
            if radius == 3:
                fit_line(s, state, at, U(wide), q, surfaces, LINE_3, dy, gate, period)
            elif radius == 2:
                fit_line(s, state, at, U(wide), q, surfaces, LINE_2, dy, gate, period)
            else:
                fit_line(s, state, at, U(wide), q, surfaces, LINE_1, dy, gate, period)


@inline
def _turn(s, steepness):
    """Turn the planes to the sums. A slope is held to 0 as by one measurement with variance 1 / steepness."""
    for x in range(B):
        f0 = s[F0 + x] + TINY
        ridge = steepness / f0 + F32(RIDGE)
        mx, my, me = s[FX + x] / f0, s[FY + x] / f0, s[FE + x] / f0
        cxx, cyy = s[FXX + x] / f0 - mx * mx, s[FYY + x] / f0 - my * my
        cxy = s[FXY + x] / f0 - mx * my
        cxe = s[FXE + x] / f0 - mx * me + cxx * s[SC + x] + cxy * s[SR + x]
        cye = s[FYE + x] / f0 - my * me + cxy * s[SC + x] + cyy * s[SR + x]
        cxx, cyy = cxx + ridge, cyy + ridge
        det = cxx * cyy - cxy * cxy
        s[SC + x] = (cyy * cxe - cxy * cye) / det
        s[SR + x] = (cxx * cye - cxy * cxe) / det


@inline
def _aim(s, cycles, m):
    """Set the phases of the steps along the planes, empty the pools."""
    for x in range(F0 - NOISE):
        s[NOISE + x] = ZERO
    for l in range(m):
        k, a = cycles[l], l * B
        for x in range(B):
            s[RE + a + x], s[IM + a + x], s[HALF_RE + a + x], s[HALF_IM + a + x] = ZERO, ZERO, ZERO, ZERO
            s[COL + a + x], s[COL + GROUP + a + x] = sincos(k * s[SC + x])
            s[ROW + a + x], s[ROW + GROUP + a + x] = sincos(k * s[SR + x])


@inline
def _turn_half(s, m, sign):
    """Turn the sums of half a window back by the slope of a row."""
    for l in range(m):
        a = l * B
        for x in range(B):
            sine, cosine = sign * s[ROW + a + x], s[ROW + GROUP + a + x]
            re, im = s[HALF_RE + a + x], s[HALF_IM + a + x]
            s[HALF_RE + a + x] = re * cosine + im * sine
            s[HALF_IM + a + x] = im * cosine - re * sine


@inline
def _add_half(s, m):
    """Move the sums of half a window to those of the whole one."""
    for x in range(m * B):
        s[RE + x] += s[HALF_RE + x]
        s[IM + x] += s[HALF_IM + x]
        s[HALF_RE + x] = ZERO
        s[HALF_IM + x] = ZERO


@inline
def _pool_row(s, maps, i, j, tall, wide, m, surfaces, half, dy, gate, period):
    """Add row dy of the windows."""
    a, b = i + dy, j - half
    at, pixel = U(a * surfaces * FIELDS * wide + b), U(a * wide + b)
    for q in range(surfaces):
        sketch = U((q * tall + a) * 2 * m * wide + b)
        if half == 6:
            pool_line(s, maps, at, sketch, pixel, U(wide), U(m), q, surfaces, LINE_6, dy, gate, period)
        elif half == 5:
            pool_line(s, maps, at, sketch, pixel, U(wide), U(m), q, surfaces, LINE_5, dy, gate, period)
        elif half == 4:
            pool_line(s, maps, at, sketch, pixel, U(wide), U(m), q, surfaces, LINE_4, dy, gate, period)
        elif half == 3:
            pool_line(s, maps, at, sketch, pixel, U(wide), U(m), q, surfaces, LINE_3, dy, gate, period)
        elif half == 2:
            pool_line(s, maps, at, sketch, pixel, U(wide), U(m), q, surfaces, LINE_2, dy, gate, period)
        elif half == 1:
            pool_line(s, maps, at, sketch, pixel, U(wide), U(m), q, surfaces, LINE_1, dy, gate, period)
        else:
            pool_line(s, maps, at, sketch, pixel, U(wide), U(m), q, surfaces, LINE_0, dy, gate, period)


@inline
def _climb(s, cycles, total, curvature, steps, m):
    """Gradient steps on Σ_l Re((re + i im)_l exp(−i ω_l d)), each divided by the curvature there.

    A step ends at the width of a peak: where the photons contradict the point the curvature says nothing.
    """
    reach = np.sqrt(total / curvature)
    for l in range(m):
        k, a = cycles[l], l * B
        for x in range(B):
            sine, cosine = sincos(k * s[T + x])
            re, im = s[RE + a + x], s[IM + a + x]
            s[RE + a + x] = re * cosine + im * sine
            s[IM + a + x] = im * cosine - re * sine
    for x in range(B):
        s[D + x] = ZERO
    for step in range(steps + 1):
        for x in range(B):
            s[VALUE + x], s[SLOPE + x], s[BEND + x] = ZERO, ZERO, ZERO
        for l in range(m):
            k, a = cycles[l], l * B
            omega = k * F32(2 * np.pi)
            for x in range(B):
                sine, cosine = sincos(k * s[D + x])
                along = s[RE + a + x] * cosine + s[IM + a + x] * sine
                s[VALUE + x] += along
                s[SLOPE + x] += omega * (s[IM + a + x] * cosine - s[RE + a + x] * sine)
                s[BEND + x] += omega * omega * along
        if step < steps:
            for x in range(B):
                least = HALF * max(s[VALUE + x], ZERO) / total * curvature
                s[D + x] += min(max(s[SLOPE + x] / (max(s[BEND + x], least) + TINY), -reach), reach)


@inline
def _finish(s, state, point, out, wide, radius, moments, total, curvature, period):
    """Write the block's next state: depth, plane, intensity of the pool per pixel, standard deviation, score."""
    for x in range(B):
        seen = state[point + INTENSITY * wide + x] > ZERO
        t = s[T + x] + s[D + x]
        noise, photons = s[NOISE + x], s[PHOTONS + x]
        strength = max(s[VALUE + x], ZERO) / total
        signal = min(strength, photons)
        spread = (signal * moments[0] + (photons - signal) * moments[1]) * noise / max(photons, TINY)
        out[point + DEPTH * wide + x] = t - period * np.floor(t / period)
        out[point + INTENSITY * wide + x] = max(strength / max(s[EXPOSURE + x], TINY), TINY) if seen else ZERO
        std = min(np.sqrt(spread) / max(signal * curvature, TINY), period)
        out[point + STD * wide + x] = std if signal > ZERO else period
        score = s[VALUE + x] / np.sqrt(HALF * noise * total + TINY)
        # A point found in a wider window than this one keeps the evidence that was found there.
        wider = F32(1.5) * state[point + WINDOW * wide + x] > radius
        score = max(score, state[point + SCORE * wide + x]) if wider else score
        out[point + SCORE * wide + x] = score if seen else ZERO
        out[point + WINDOW * wide + x] = state[point + WINDOW * wide + x]
        out[point + SLOPE_COL * wide + x] = s[SC + x]
        out[point + SLOPE_ROW * wide + x] = s[SR + x]


@parallel
def _descend(sketches, noise, exposure, energy, cycles, num_bins, moments, gate, widths, fit, steps, shape,
             state, out):
    """The maps come flat, their `shape` is [rows', K, FIELDS, cols']."""
    tall, surfaces, fields, wide = shape
    m, radius = len(energy), len(widths) - 1
    period, total = F32(num_bins), total_of(energy)
    curvature = total_of(energy * cycles * cycles) * F32(4 * np.pi**2)
    maps = (state, sketches, noise, exposure)
    for row in prange(tall - 2 * MARGIN):
        i = row + MARGIN
        s = aligned(SCRATCH)
        for j in range(MARGIN, wide - MARGIN, BLOCK):
            for k in range(surfaces):
                point = U((i * surfaces + k) * fields * wide + j)
                _begin(s, state, point, U(wide), radius, gate)
                for _ in range(FITS):
                    _fit(s, state, i, j, wide, surfaces, fit, gate, period)
                    _turn(s, curvature / total)
                _aim(s, cycles, U(m))
                for side in range(1, -2, -2):
                    for d in range(radius, 0, -1):
                        _pool_row(s, maps, i, j, tall, wide, m, surfaces, widths[d], side * d, gate, period)
                        _turn_half(s, U(m), F32(side))
                    _add_half(s, U(m))
                _pool_row(s, maps, i, j, tall, wide, m, surfaces, widths[0], 0, gate, period)
                _add_half(s, U(m))
                _climb(s, cycles, total, curvature, steps, U(m))
                _finish(s, state, point, out, U(wide), F32(radius), moments, total, curvature, period)


def descend(data, state, radius, gate, steps=3, out=None):
    """Gradient steps of every point on the sketches pooled around it.

    Args:
        data: the frame (see `srt3d_ros.core.frame.Frame`).
        state: float32 [rows', K, FIELDS, cols'].
        radius: of the window, pixels, at most MARGIN.
        gate: square of the number of standard deviations within which depths may belong to one surface.
        steps: gradient steps.

    Returns:
        The next state: depth, slopes, intensity (of the pool, per pixel), std and score.
    """
    sketches = explain(data, state)
    out = np.zeros_like(state) if out is None else out
    fit = min(radius, FIT_RADIUS)
    widths = np.array([layout.half_width(radius, line) for line in range(radius + 1)])
    _descend(sketches.reshape(-1), data.noise.reshape(-1), data.exposure.reshape(-1), data.energy, data.cycles,
             data.num_bins, data.moments, F32(gate), widths, fit, steps, state.shape,
             state.reshape(-1), out.reshape(-1))
    return out
