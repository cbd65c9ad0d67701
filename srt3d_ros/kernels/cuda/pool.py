"""What `descend` does to the window of a point: weigh its pixels, fit a plane through them, pool their sketches."""

import triton
import triton.language as tl

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cuda.arithmetic import TINY, sincos, wrap
from srt3d_ros.kernels.cuda.layout import BLOCK, DEPTH, FIELDS, INTENSITY, STD

RIDGE, STD_FLOOR = tl.constexpr(constants.RIDGE), tl.constexpr(constants.STD_FLOOR)


@triton.jit
def half_width(line, RADIUS: tl.constexpr):
    """Pixels on each side of a round window's line, as `srt3d_ros.core.layout.half_width`."""
    half = 0
    for x in tl.static_range(1, RADIUS + 1):
        half = tl.where(x * x + line * line <= RADIUS * (RADIUS + 1), x, half)
    return half


@triton.jit
def _weigh(at, wide, q, plane, variance, near, gate, period, SURFACES: tl.constexpr):
    """How much a neighbour's surface q counts for a point, how much its pixel as one without surfaces, and distances.

    A neighbour counts by its distance and by how well its surface lies on the point's plane: not at all beyond
    sqrt(gate) standard deviations. A pixel with no surface counts by its distance alone, one with several by the
    nearest.

    Args:
        at: pointers to the neighbours in the state, surface 0, field 0.
        q: known when compiling.
        plane: depths of the points' planes there.
        variance: gate · σ² of the points.
        near: weights by distance.

    Returns:
        The weights as lit and as blank pixel, the distance from the plane in bins, and the depth's variance.
    """
    mine = at + q * FIELDS * wide
    e = wrap(tl.load(mine + DEPTH * wide) - plane, period)
    std = tl.load(mine + STD * wide)
    seen = tl.load(mine + INTENSITY * wide) > 0.0
    noisy = std * std
    close = tl.maximum(1.0 - e * e / (variance + gate * noisy), 0.0)
    lit = tl.where(seen, near * close * close, 0.0)
    blank = tl.where(seen, 0.0, near) if q == 0 else tl.zeros_like(lit)
    for o in tl.static_range(SURFACES):
        if o != q:
            other = at + o * FIELDS * wide
            away = wrap(tl.load(other + DEPTH * wide) - plane, period)
            there = tl.load(other + INTENSITY * wide) > 0.0
            blank = tl.where(there, 0.0, blank)
            lit = tl.where(there & (tl.abs(away) < tl.abs(e)), 0.0, lit)
    return lit, blank, e, noisy


@triton.jit
def fit(points, wide, t, sc, sr, variance, fall, gate, period, steepness,
        RADIUS: tl.constexpr, WIDTH: tl.constexpr, SURFACES: tl.constexpr):
    """Turn points' planes to the surfaces around them, by moving least squares.

    The window is square. The pixels of a line are weighed at once, so that there is work while some wait for memory.

    Args:
        points: pointers [BLOCK] to the points' pixels in the state, surface 0, field 0.
        t, sc, sr: [BLOCK], the points' depths and slopes.
        variance: as of `_weigh`.
        fall: [BLOCK], weights by distance d are 2^(fall · d²).
        steepness: a slope is held to 0 as by one measurement with variance 1 / steepness.
        WIDTH: of a window, or the next power of two: padding lies in the map's margin and weighs nothing.

    Returns:
        The slopes.
    """
    x = tl.arange(0, WIDTH)[:, None] - RADIUS
    # Sums over the columns of the window; those along its lines are taken at the end.
    one, down, down2, off, off_down = (tl.zeros([WIDTH, BLOCK], tl.float32), tl.zeros([WIDTH, BLOCK], tl.float32),
                                       tl.zeros([WIDTH, BLOCK], tl.float32), tl.zeros([WIDTH, BLOCK], tl.float32),
                                       tl.zeros([WIDTH, BLOCK], tl.float32))
    for dy in range(-RADIUS, RADIUS + 1):
        near = tl.where(x <= RADIUS, tl.exp2(fall[None, :] * (x * x + dy * dy)), 0.0)
        plane = (t + sr * dy)[None, :] + sc[None, :] * x
        for q in tl.static_range(SURFACES):
            at = points + dy * SURFACES * FIELDS * wide + x
            lit, _, e, noisy = _weigh(at, wide, q, plane, variance[None, :], near, gate, period, SURFACES)
            f = lit / (noisy + STD_FLOOR)
            one += f
            down += f * dy
            down2 += f * (dy * dy)
            off += f * e
            off_down += f * e * dy
    f0 = tl.sum(one, axis=0) + TINY
    ridge = steepness / f0 + RIDGE
    mx, my, me = tl.sum(one * x, axis=0) / f0, tl.sum(down, axis=0) / f0, tl.sum(off, axis=0) / f0
    cxx, cyy = tl.sum(one * (x * x), axis=0) / f0 - mx * mx, tl.sum(down2, axis=0) / f0 - my * my
    cxy = tl.sum(down * x, axis=0) / f0 - mx * my
    cxe = tl.sum(off * x, axis=0) / f0 - mx * me + cxx * sc + cxy * sr
    cye = tl.sum(off_down, axis=0) / f0 - my * me + cxy * sc + cyy * sr
    cxx, cyy = cxx + ridge, cyy + ridge
    det = cxx * cyy - cxy * cxy
    return (cyy * cxe - cxy * cye) / det, (cxx * cye - cxy * cxe) / det


@triton.jit
def _turn(re, im, sine, cosine):
    """Turn sums forward by a phase."""
    return re * cosine - im * sine, im * cosine + re * sine


@triton.jit
def pool(points, sketches, noise, exposure, wide, m, layer, known, cycle, t, sc, sr, variance, fall, gate, period,
         RADIUS: tl.constexpr, SURFACES: tl.constexpr):
    """Add up the weighted sketches of round windows, turned back by where the points' planes are.

    Horner's scheme along one path, down the window in lines from side to side: what it has gathered is turned by the
    plane's rise at each step, and the next sketch added. That is 6 operations for each pixel and frequency, and one
    accumulator; to turn and to add each sketch on its own would be 10.

    Args:
        points: as of `fit`.
        sketches: pointers [M, BLOCK] to the real parts of the points' pixels, surface 0.
        noise, exposure: pointers [BLOCK] to those of the points' pixels.
        wide, m, layer: columns of the maps, frequencies, and numbers in the sketches of one surface.
        known: [M, 1], which frequencies there are.
        cycle: float32 [M, 1], k_l / T.
        t, sc, sr, variance, fall: as of `fit`.

    Returns:
        Real and imaginary parts [M, BLOCK]; Σ w² · noise, Σ w · noise and Σ w · exposure, [BLOCK].
    """
    col_sine, col_cosine = sincos(cycle * sc[None, :])
    row_sine, row_cosine = sincos(cycle * sr[None, :])
    re, im = tl.zeros_like(col_sine), tl.zeros_like(col_sine)
    squares, photons, exposures = tl.zeros_like(t), tl.zeros_like(t), tl.zeros_like(t)
    x, side = -half_width(RADIUS, RADIUS), 1
    for dy in range(-RADIUS, RADIUS + 1):
        # The next line may be longer, so that the path must go beyond the end of this one; nothing counts there.
        end = tl.maximum(half_width(dy, RADIUS), half_width(dy + 1, RADIUS))
        re, im = _turn(re, im, row_sine, row_cosine)
        re, im = _turn(re, im, -col_sine, col_cosine)               # a step back, since a step begins with one forward
        x -= side
        # Unrolled, two pixels wait for memory at once, and no register is copied from step to step.
        for _ in tl.range(0, end - side * x, loop_unroll_factor=2):
            x += side
            away2 = x * x + dy * dy
            near = tl.where(away2 <= RADIUS * (RADIUS + 1), tl.exp2(fall * away2), 0.0)
            plane = t + sr * dy + sc * x
            n, g = tl.load(noise + dy * wide + x), tl.load(exposure + dy * wide + x)
            re, im = _turn(re, im, col_sine, col_cosine)
            for q in tl.static_range(SURFACES):
                at = points + dy * SURFACES * FIELDS * wide + x
                lit, blank, _, _ = _weigh(at, wide, q, plane, variance, near, gate, period, SURFACES)
                w = lit + blank
                squares += w * w * n
                photons += w * n
                exposures += w * g
                z = sketches + q * layer + dy * 2 * m * wide + x
                re += w[None, :] * tl.load(z, mask=known, other=0.0)
                im += w[None, :] * tl.load(z + m * wide, mask=known, other=0.0)
        side, col_sine = -side, -col_sine
    sine, cosine = sincos(cycle * (t + sr * RADIUS + sc * x)[None, :])
    return re * cosine + im * sine, im * cosine - re * sine, squares, photons, exposures
