"""Which pixels `propose` has to decide on: those at edges and in gaps; elsewhere the neighbourhood agrees."""

from srt3d_ros.core.layout import BLOCK, FIELDS
from srt3d_ros.kernels.constants import ENOUGH
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, TWO, ZERO, aligned, wrap
from srt3d_ros.kernels.cpu.compiling import inline, line
from srt3d_ros.kernels.cpu.fields import DEPTH, INTENSITY, SLOPE_COL, SLOPE_ROW, STD, B, U

HAD, FOUND, OPEN, COUNT, THERE, KNOWN, AT, NOISY = (U(k * BLOCK) for k in range(8))     # offsets into the scratch


@inline
def survey_scratch():
    """Scratch for `survey`."""
    return aligned(8 * BLOCK)


@line
def survey(s, state, here, surfaces, wide, gate, blur2, period, astray, room_only):
    """Set BLOCK numbers from OPEN on in s to 1 where something is to be decided, else 0.

    Where a pixel has surfaces, nothing is if all of the 3 × 3 neighbourhood belong to them, and no neighbour has fewer;
    where it has none, if hardly any neighbour has one.

    Args:
        s: of `survey_scratch`; from HAD on it gets the number of each pixel's surfaces.
        state: flat.
        here: index of the first pixel's depth in it.
        surfaces, wide: K, cols'.
        gate, blur2: of `propose`: points are one surface if e² < gate · variances + 2 blur2.
        period: T.
        astray: std from which on a point says nothing of the depth, bins.
        room_only: whether nothing is to be decided where pixels have all K surfaces.
    """
    for x in range(B):
        s[HAD + x], s[FOUND + x], s[OPEN + x] = ZERO, ZERO, ZERO
    for k in range(surfaces):
        mine = U(here + k * FIELDS * wide)
        for x in range(B):
            there = (state[mine + INTENSITY * wide + x] > ZERO) & (state[mine + STD * wide + x] < astray)
            s[HAD + x] += ONE if there else ZERO
    if room_only:
        least = F32(surfaces)
        for x in range(B):
            least = min(least, s[HAD + x])
        if least == F32(surfaces):
            return
    for di in range(-1, 2):
        for dj in range(-1, 2):
            for x in range(B):
                s[COUNT + x] = ZERO
            for q in range(surfaces):
                at = U(here + (di * surfaces + q) * FIELDS * wide + dj)
                _compare(s, state, at, here, surfaces, wide, F32(di), F32(dj), gate, blur2, period, astray)
            for x in range(B):
                s[FOUND + x] += s[COUNT + x]
                fewer = (s[COUNT + x] > ZERO) & (s[COUNT + x] < s[HAD + x])
                s[OPEN + x] = ONE if fewer else s[OPEN + x]
    for x in range(B):
        gap = ONE if s[FOUND + x] >= F32(ENOUGH) else ZERO
        s[OPEN + x] = gap if s[HAD + x] == ZERO else s[OPEN + x]


@inline
def _compare(s, state, at, here, surfaces, wide, dy, dx, gate, blur2, period, astray):
    """Count the surface of a neighbour at (dy, dx), whose depth is at `at`, and open pixels that do not know it."""
    for x in range(B):
        std = state[at + STD * wide + x]
        there = (state[at + INTENSITY * wide + x] > ZERO) & (std < astray)
        s[THERE + x] = ONE if there else ZERO
        s[NOISY + x] = gate * std * std + TWO * blur2
        s[KNOWN + x] = ZERO
    for x in range(B):
        s[AT + x] = state[at + DEPTH * wide + x] - state[at + SLOPE_COL * wide + x] * dx
        s[AT + x] -= state[at + SLOPE_ROW * wide + x] * dy
    for k in range(surfaces):
        mine = U(here + k * FIELDS * wide)
        for x in range(B):
            e = wrap(s[AT + x] - state[mine + DEPTH * wide + x], period)
            std = state[mine + STD * wide + x]
            close = (e * e < s[NOISY + x] + gate * std * std) & (std < astray)
            close = close & (state[mine + INTENSITY * wide + x] > ZERO)
            s[KNOWN + x] = ONE if close else s[KNOWN + x]
    for x in range(B):
        s[COUNT + x] += s[THERE + x]
        strange = (s[THERE + x] > ZERO) & (s[KNOWN + x] == ZERO)
        s[OPEN + x] = ONE if strange else s[OPEN + x]
