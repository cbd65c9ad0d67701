"""One iteration's gradient steps: measure every point's tangent plane, pool the sketches along it, climb.

Written for vector registers. What a block of columns needs lives in one flat scratch array whose parts lie at offsets
known at compile time, and indices are unsigned: only so can the compiler see that the parts do not overlap and that no
index counts from the end.
"""

import numpy as np
from numba import prange

from srt3d_ros.core import layout
from srt3d_ros.core.layout import BLOCK, FIELDS, MARGIN
from srt3d_ros.core.sketch import MAX_SKETCH_SIZE
from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, ONE, TINY, ZERO, inline, parallel, sincos, wrap

FITS = 2                     # of a plane: the first decides which neighbours lie on it, the second goes through them
FIT_RADIUS = 3               # pixels: farther neighbours pool, but no longer tilt the plane
RIDGE = F32(1e-3)            # pixels²: keeps the plane finite where its support is a line
STD_FLOOR = F32(0.01)        # bins²: keeps the plane's weights finite

U = np.uint64
B = U(BLOCK)
DEPTH, SLOPE_COL, SLOPE_ROW, INTENSITY, STD, WINDOW, SCORE = (U(getattr(layout, name)) for name in (
    "DEPTH", "SLOPE_COL", "SLOPE_ROW", "INTENSITY", "STD", "WINDOW", "SCORE"))

# Offsets into the scratch array: single rows of BLOCK numbers, then groups of a row for each frequency.
(T, SC, SR, VARIANCE, W, CLOSE, VALUE, SLOPE, BEND, D, NOISE, PHOTONS, EXPOSURE,
 F0, FX, FY, FXX, FYY, FXY, FE, FXE, FYE) = (U(k * BLOCK) for k in range(22))
NEAR = U(22 * BLOCK)
GROUP = U(MAX_SKETCH_SIZE * BLOCK)
RE, IM, COL, ROW, LINE, AT = (U(22 * BLOCK + (MARGIN + 1) * BLOCK) + U(k) * GROUP for k in (0, 1, 2, 4, 6, 8))
SCRATCH = int(AT + U(2) * GROUP)        # COL, ROW, LINE, AT: a group of sines, then one of cosines


@inline
def _rotate(s, p, step, m):
    """Turn the phases at `p` by those at `step`."""
    for l in range(m):
        a, c = p + l * B, step + l * B
        for x in range(B):
            ps, pc = s[a + x], s[a + GROUP + x]
            ts, tc = s[c + x], s[c + GROUP + x]
            s[a + x] = ps * tc + pc * ts
            s[a + GROUP + x] = pc * tc - ps * ts


@inline
def _copy_line(s, m):
    """Phases at the start of a window's line."""
    for l in range(m):
        a, c = AT + l * B, LINE + l * B
        for x in range(B):
            s[a + x] = s[c + x]
            s[a + GROUP + x] = s[c + GROUP + x]


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
def _aim(s, cycles, radius, m):
    """Set the phases for the corner of the windows and for the steps along the planes, empty the pools."""
    for x in range(F0 - NOISE):
        s[NOISE + x] = ZERO
    r = F32(radius)
    for l in range(m):
        k, a = cycles[l], l * B
        for x in range(B):
            s[RE + a + x] = ZERO
            s[IM + a + x] = ZERO
            s[COL + a + x], s[COL + GROUP + a + x] = sincos(k * s[SC + x])
            s[ROW + a + x], s[ROW + GROUP + a + x] = sincos(k * s[SR + x])
            s[LINE + a + x], s[LINE + GROUP + a + x] = sincos(k * (s[T + x] - (s[SC + x] + s[SR + x]) * r))


@inline
def _weigh(s, state, at, wide, q, surfaces, di, dj, gate, period):
    """Weights of the neighbours at (di, dj) for their surface q: to pool them, and to fit planes through them.

    A neighbour counts by its distance and by how well its surface lies on the point's plane: not at all beyond
    sqrt(gate) standard deviations. A pixel with no surface counts by its distance alone, one with several by the
    nearest.
    """
    dx, dy = F32(dj), F32(di)
    near_row, near_col = NEAR + U(abs(di)) * B, NEAR + U(abs(dj)) * B
    mine = at + q * U(FIELDS) * wide
    for x in range(B):
        rise = s[SC + x] * dx + s[SR + x] * dy
        e = wrap(state[mine + DEPTH * wide + x] - s[T + x] - rise, period)
        noisy = state[mine + STD * wide + x] * state[mine + STD * wide + x]
        close = max(ONE - e * e / (s[VARIANCE + x] + gate * noisy), ZERO)
        seen = state[mine + INTENSITY * wide + x] > ZERO
        w = s[near_row + x] * s[near_col + x]
        blank = w if q == 0 else ZERO
        lit = w * close * close if seen else ZERO
        s[W + x] = lit if seen else blank
        s[CLOSE + x] = lit / (noisy + STD_FLOOR)
        s[D + x] = e
    for o in range(surfaces):
        if o != q:
            other = at + o * U(FIELDS) * wide
            for x in range(B):
                rise = s[SC + x] * dx + s[SR + x] * dy
                e = wrap(state[other + DEPTH * wide + x] - s[T + x] - rise, period)
                there = state[other + INTENSITY * wide + x] > ZERO
                empty = state[mine + INTENSITY * wide + x] <= ZERO
                drop = there and (empty or abs(e) < abs(s[D + x]))
                s[W + x] = ZERO if drop else s[W + x]
                s[CLOSE + x] = ZERO if drop else s[CLOSE + x]


@inline
def _fit(s, di, dj):
    """Add the weighed neighbours to the sums of the planes, by moving least squares."""
    dx, dy = F32(dj), F32(di)
    for x in range(B):
        f, e = s[CLOSE + x], s[D + x]
        s[F0 + x] += f
        s[FX + x] += f * dx
        s[FY + x] += f * dy
        s[FXX + x] += f * dx * dx
        s[FYY + x] += f * dy * dy
        s[FXY + x] += f * dx * dy
        s[FE + x] += f * e
        s[FXE + x] += f * e * dx
        s[FYE + x] += f * e * dy


@inline
def _turn(s, steepness):
    """Turn the planes to the sums. A slope is held to 0 as by one measurement with variance 1 / steepness."""
    for x in range(B):
        f0 = s[F0 + x] + TINY
        ridge = steepness / f0 + RIDGE
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
def _pool(s, sketches, sketch, noise, exposure, at, wide, m):
    """Add the weighted sketches of one offset, turned back by where the planes are there."""
    for x in range(B):
        w = s[W + x]
        s[NOISE + x] += w * w * noise[at + x]
        s[PHOTONS + x] += w * noise[at + x]
        s[EXPOSURE + x] += w * exposure[at + x]
    for l in range(m):
        re, im, a = sketch + l * wide, sketch + (m + l) * wide, l * B
        for x in range(B):
            wr, wi = s[W + x] * sketches[re + x], s[W + x] * sketches[im + x]
            sine, cosine = s[AT + a + x], s[AT + GROUP + a + x]
            s[RE + a + x] += wr * cosine + wi * sine
            s[IM + a + x] += wi * cosine - wr * sine


@inline
def _climb(s, cycles, total, curvature, steps, m):
    """Gradient steps on Σ_l Re((re + i im)_l exp(−i ω_l d)), each divided by the curvature there.

    A step ends at the width of a peak: where the photons contradict the point the curvature says nothing.
    """
    reach = np.sqrt(total / curvature)
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
def _descend(sketches, noise, exposure, energy, cycles, num_bins, moments, gate, radius, steps, shape, state, out):
    """The maps come flat, their `shape` is [rows', K, FIELDS, cols']."""
    tall, surfaces, fields, wide = shape
    m = len(energy)
    period, total = F32(num_bins), energy.sum()
    curvature = (energy * cycles * cycles).sum() * F32(4 * np.pi**2)
    for row in prange(tall - 2 * MARGIN):
        i = row + MARGIN
        s = np.empty(SCRATCH, np.float32)
        near = min(radius, FIT_RADIUS)
        for j in range(MARGIN, wide - MARGIN, BLOCK):
            for k in range(surfaces):
                point = U((i * surfaces + k) * fields * wide + j)
                _begin(s, state, point, U(wide), radius, gate)
                for fit in range(FITS):
                    for x in range(NEAR - F0):
                        s[F0 + x] = ZERO
                    for di in range(-near, near + 1):
                        for dj in range(-near, near + 1):
                            for q in range(surfaces):
                                at = U((i + di) * surfaces * fields * wide + j + dj)
                                _weigh(s, state, at, U(wide), U(q), U(surfaces), di, dj, gate, period)
                                _fit(s, di, dj)
                    _turn(s, curvature / total)
                _aim(s, cycles, radius, U(m))
                for di in range(-radius, radius + 1):
                    _copy_line(s, U(m))
                    for dj in range(-radius, radius + 1):
                        a, b = i + di, j + dj
                        for q in range(surfaces):
                            _weigh(s, state, U(a * surfaces * fields * wide + b), U(wide), U(q), U(surfaces), di, dj,
                                   gate, period)
                            _pool(s, sketches, U((q * tall + a) * 2 * m * wide + b), noise, exposure, U(a * wide + b),
                                  U(wide), U(m))
                        _rotate(s, AT, COL, U(m))
                    _rotate(s, LINE, ROW, U(m))
                _climb(s, cycles, total, curvature, steps, U(m))
                _finish(s, state, point, out, U(wide), F32(radius), moments, total, curvature, period)


@parallel
def _explain(matched, exposure, energy, cycles, state, rest):
    tall, surfaces, _, wide = state.shape
    m = len(energy)
    for i in prange(tall):
        for j in range(wide):
            for k in range(surfaces):
                rest[k, i, :, j] = matched[i, :, j]
                for o in range(surfaces):
                    known = state[i, o, layout.INTENSITY, j] * exposure[i, j]
                    if o != k and known > ZERO:
                        for l in range(m):
                            sine, cosine = sincos(cycles[l] * state[i, o, layout.DEPTH, j])
                            rest[k, i, l, j] -= known * energy[l] * cosine
                            rest[k, i, m + l, j] -= known * energy[l] * sine


def explain(data, state):
    """What is left of the pixels' sketches for each of their surfaces when the others are taken out.

    Returns:
        float32 [K, rows', 2m, cols'].
    """
    if state.shape[1] == 1:
        return data.matched[None]
    rest = np.empty((state.shape[1], *data.matched.shape), np.float32)
    _explain(data.matched, data.exposure, data.energy, data.cycles, state, rest)
    return rest


def descend(data, state, radius, gate, steps=3):
    """Gradient steps of every point on the sketches pooled around it.

    Args:
        data: the frame (see `srt3d_ros.core.srt3d.Frame`).
        state: float32 [rows', K, FIELDS, cols'].
        radius: of the window, pixels, at most MARGIN.
        gate: square of the number of standard deviations within which depths may belong to one surface.
        steps: gradient steps.

    Returns:
        The next state: depth, slopes, intensity (of the pool, per pixel), std and score.
    """
    sketches = explain(data, state)
    after = np.zeros_like(state)
    _descend(sketches.reshape(-1), data.noise.reshape(-1), data.exposure.reshape(-1), data.energy, data.cycles,
             data.num_bins, data.moments, F32(gate), radius, steps, state.shape, state.reshape(-1), after.reshape(-1))
    return after
