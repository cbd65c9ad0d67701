"""Which pixels the birth/death update has to look at: those at edges and gaps. Elsewhere the neighbourhood agrees."""

from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO, aligned
from srt3d_ros.kernels.cpu.compiling import inline, line
from srt3d_ros.kernels.cpu.fields import DEPTH, INTENSITY, SLOPE_COL, SLOPE_ROW, STD, B, U
from srt3d_ros.kernels.cpu.surfaces import distance, is_surface, rise
from srt3d_ros.kernels.maps import BLOCK, FIELDS

OWN, FOUND, OPEN, COUNT, THERE, KNOWN, AT, TOLERANCE = (U(k * BLOCK) for k in range(8))     # offsets into the scratch


@inline
def undecided_scratch():
    """Scratch for `undecided`."""
    return aligned(8 * BLOCK)


@line
def undecided(s, state, here, surfaces, padded_cols, max_chi2, blur2, period, max_std):
    """Set BLOCK numbers from OPEN on in s to 1 where something is to be decided, else 0; from OWN on: own surfaces.

    A pixel with surfaces is decided if all of the 3 × 3 neighbourhood belong to them, and no neighbour has fewer; one
    without surfaces, if no neighbour has one.

    Args:
        s: of `undecided_scratch`.
        state: flat.
        here: index of the first pixel's depth in it.
        max_chi2, blur2: two depths are one surface's if e² < max_chi2 · variances + 2 blur2.
        max_std: standard deviation from which on a point says nothing of the depth, bins.
    """
    for x in range(B):
        s[OWN + x], s[FOUND + x], s[OPEN + x] = ZERO, ZERO, ZERO
    for k in range(surfaces):
        mine = U(here + k * FIELDS * padded_cols)
        for x in range(B):
            there = is_surface(state[mine + INTENSITY * padded_cols + x], state[mine + STD * padded_cols + x], max_std)
            s[OWN + x] += ONE if there else ZERO
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            for x in range(B):
                s[COUNT + x] = ZERO
            for q in range(surfaces):
                at = U(here + (dy * surfaces + q) * FIELDS * padded_cols + dx)
                _compare(s, state, at, here, surfaces, padded_cols, F32(dx), F32(dy), max_chi2, blur2, period, max_std)
            for x in range(B):
                s[FOUND + x] += s[COUNT + x]
                fewer = (s[COUNT + x] > ZERO) & (s[COUNT + x] < s[OWN + x])
                s[OPEN + x] = ONE if fewer else s[OPEN + x]
    for x in range(B):
        gap = ONE if s[FOUND + x] > ZERO else ZERO
        s[OPEN + x] = gap if s[OWN + x] == ZERO else s[OPEN + x]


@inline
def _compare(s, state, at, here, surfaces, padded_cols, dx, dy, max_chi2, blur2, period, max_std):
    """Count the surface of a neighbour at (dx, dy), whose depth is at `at`, and open pixels that do not know it."""
    for x in range(B):
        std = state[at + STD * padded_cols + x]
        there = is_surface(state[at + INTENSITY * padded_cols + x], std, max_std)
        s[THERE + x] = ONE if there else ZERO
        s[TOLERANCE + x] = max_chi2 * std * std + blur2 + blur2
        s[KNOWN + x] = ZERO
    for x in range(B):
        s[AT + x] = state[at + DEPTH * padded_cols + x] - rise(
            state[at + SLOPE_COL * padded_cols + x], state[at + SLOPE_ROW * padded_cols + x], dx, dy)
    for k in range(surfaces):
        mine = U(here + k * FIELDS * padded_cols)
        for x in range(B):
            e = distance(s[AT + x], state[mine + DEPTH * padded_cols + x], period)
            std = state[mine + STD * padded_cols + x]
            same = (e * e < s[TOLERANCE + x] + max_chi2 * std * std) & is_surface(
                state[mine + INTENSITY * padded_cols + x], std, max_std)
            s[KNOWN + x] = ONE if same else s[KNOWN + x]
    for x in range(B):
        s[COUNT + x] += s[THERE + x]
        strange = (s[THERE + x] > ZERO) & (s[KNOWN + x] == ZERO)
        s[OPEN + x] = ONE if strange else s[OPEN + x]
