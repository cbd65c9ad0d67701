"""What `descend` does to a line of a window: weigh its pixels, fit planes through them, pool their sketches.

Written for vector registers. What a block of columns needs lives in one flat scratch array whose parts lie at offsets
known at compile time, and indices are unsigned: only so can the compiler see that the parts do not overlap and that no
index counts from the end. The length of a line comes as that of a tuple, which numba compiles for: so loops over it
unroll, sums along the line stay in registers, and the columns fill the vectors.
"""

from srt3d_ros.core.layout import BLOCK, FIELDS, MARGIN
from srt3d_ros.core.sketch import MAX_SKETCH_SIZE
from srt3d_ros.kernels.constants import STD_FLOOR
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO, wrap
from srt3d_ros.kernels.cpu.compiling import inline, line
from srt3d_ros.kernels.cpu.fields import DEPTH, INTENSITY, STD, B, U

# Lengths of a window's lines.
LINE_0, LINE_1, LINE_2, LINE_3, LINE_4, LINE_5, LINE_6 = ((0,) * (2 * half + 1) for half in range(MARGIN + 1))

# Offsets into the scratch array: single rows of BLOCK numbers, weights along a line, a row for each frequency.
(T, SC, SR, VARIANCE, W, CLOSE, VALUE, SLOPE, BEND, D, NOISE, PHOTONS, EXPOSURE,
 F0, FX, FY, FXX, FYY, FXY, FE, FXE, FYE, BASE, ROW_NEAR, BLANK, NOISY) = (U(k * BLOCK) for k in range(26))
NEAR = U(26) * B                                # by distance, 0 … MARGIN
WEIGHTS = NEAR + U(MARGIN + 1) * B              # of the pixels of a line
APART = WEIGHTS + U(2 * MARGIN + 1) * B         # the same times their distance from the plane
GROUP = U(MAX_SKETCH_SIZE) * B
RE, IM, HALF_RE, HALF_IM, COL, ROW = (APART + U(2 * MARGIN + 1) * B + U(k) * GROUP for k in (0, 1, 2, 3, 4, 6))
SCRATCH = int(ROW + U(2) * GROUP)               # COL, ROW: a group of sines, then one of cosines


@inline
def _weigh(s, state, at, wide, q, surfaces, k, half, gate, period):
    """Weigh pixel k of a line: W as one that shows the surface, BLANK as one that shows none; D: its distance, bins.

    A neighbour counts by its distance and by how well its surface lies on the point's plane: not at all beyond
    sqrt(gate) standard deviations. A pixel with no surface counts by its distance alone, one with several by the
    nearest.
    """
    dx, near, mine = F32(k - half), NEAR + U(abs(k - half)) * B, at + U(q) * U(FIELDS) * wide + U(k)
    for x in range(B):
        e = wrap(state[mine + DEPTH * wide + x] - s[BASE + x] - s[SC + x] * dx, period)
        noisy = state[mine + STD * wide + x] * state[mine + STD * wide + x]
        close = max(ONE - e * e / (s[VARIANCE + x] + gate * noisy), ZERO)
        seen = state[mine + INTENSITY * wide + x] > ZERO
        w = s[ROW_NEAR + x] * s[near + x]
        s[W + x] = w * close * close if seen else ZERO
        s[BLANK + x] = ZERO if seen else w
        s[D + x] = e
        s[NOISY + x] = noisy
    for o in range(surfaces):
        if o != q:
            other = at + U(o) * U(FIELDS) * wide + U(k)
            for x in range(B):
                e = wrap(state[other + DEPTH * wide + x] - s[BASE + x] - s[SC + x] * dx, period)
                there = state[other + INTENSITY * wide + x] > ZERO
                s[W + x] = ZERO if there & (abs(e) < abs(s[D + x])) else s[W + x]
                s[BLANK + x] = ZERO if there | (q > 0) else s[BLANK + x]


@inline
def _set_row(s, dy):
    """Set what the pixels of a line have in common: where the planes are in its middle, and weights by rows between."""
    near = NEAR + U(abs(dy)) * B
    for x in range(B):
        s[BASE + x] = s[T + x] + s[SR + x] * F32(dy)
        s[ROW_NEAR + x] = s[near + x]


@line
def fit_line(s, state, at, wide, q, surfaces, pixels, dy, gate, period):
    """Add the surfaces q of a line to the sums of the planes, by moving least squares.

    Args:
        s: the scratch array.
        state: flat.
        at: index of the line's leftmost pixel, field 0.
        surfaces: K.
        pixels: a tuple as long as the line.
        dy: row of the line from the point.
    """
    half = len(pixels) // 2
    down = F32(dy)
    _set_row(s, dy)
    for k in range(len(pixels)):
        _weigh(s, state, at, wide, q, surfaces, k, half, gate, period)
        weights, apart = WEIGHTS + U(k) * B, APART + U(k) * B
        for x in range(B):
            f = s[W + x] / (s[NOISY + x] + F32(STD_FLOOR))
            s[weights + x] = f
            s[apart + x] = f * s[D + x]
    for x in range(B):
        f0, fx, fxx, fe, fxe = ZERO, ZERO, ZERO, ZERO, ZERO
        for k in range(len(pixels)):
            dx, f, apart = F32(k - half), s[WEIGHTS + U(k) * B + x], s[APART + U(k) * B + x]
            f0 += f
            fx += f * dx
            fxx += f * dx * dx
            fe += apart
            fxe += apart * dx
        s[F0 + x] += f0
        s[FX + x] += fx
        s[FY + x] += f0 * down
        s[FXX + x] += fxx
        s[FYY + x] += f0 * down * down
        s[FXY + x] += fx * down
        s[FE + x] += fe
        s[FXE + x] += fxe
        s[FYE + x] += fe * down


@line
def pool_line(s, maps, at, sketch, pixel, wide, m, q, surfaces, pixels, dy, gate, period):
    """Add the weighted sketches of a line's surfaces q, turned back by where the planes are, into HALF_RE, HALF_IM.

    Horner's scheme: from both ends of the line to its middle, each time turned by one pixel's slope. That is 6
    operations for each pixel and frequency; to turn and to add each sketch on its own would be 10.

    Args: as of `fit_line`, and
        maps: state, sketches, noise and exposure, flat.
        sketch, pixel: index of the line's leftmost pixel in the maps after the first.
    """
    state, sketches, noise, exposure = maps
    half = len(pixels) // 2
    _set_row(s, dy)
    for k in range(len(pixels)):
        _weigh(s, state, at, wide, q, surfaces, k, half, gate, period)
        weights = WEIGHTS + U(k) * B
        for x in range(B):
            s[weights + x] = s[W + x] + s[BLANK + x]
    for x in range(B):
        squares, photons, exposures = ZERO, ZERO, ZERO
        for k in range(len(pixels)):
            w, n = s[WEIGHTS + U(k) * B + x], noise[pixel + U(k) + x]
            squares += w * w * n
            photons += w * n
            exposures += w * exposure[pixel + U(k) + x]
        s[NOISE + x] += squares
        s[PHOTONS + x] += photons
        s[EXPOSURE + x] += exposures
    middle, last = U(half), U(2 * half)
    for l in range(m):
        a, re, im = l * B, sketch + l * wide, sketch + (m + l) * wide
        for x in range(B):
            sine, cosine = s[COL + a + x], s[COL + GROUP + a + x]
            right, right_im, left, left_im = ZERO, ZERO, ZERO, ZERO
            for k in range(half):
                w, p = s[WEIGHTS + (last - U(k)) * B + x], last - U(k) + x
                right, right_im = (right * cosine + right_im * sine + w * sketches[re + p],
                                   right_im * cosine - right * sine + w * sketches[im + p])
                w, p = s[WEIGHTS + U(k) * B + x], U(k) + x
                left, left_im = (left * cosine - left_im * sine + w * sketches[re + p],
                                 left_im * cosine + left * sine + w * sketches[im + p])
            w, p = s[WEIGHTS + middle * B + x], middle + x
            s[HALF_RE + a + x] += (right + left) * cosine + (right_im - left_im) * sine + w * sketches[re + p]
            s[HALF_IM + a + x] += (right_im + left_im) * cosine - (right - left) * sine + w * sketches[im + p]
