"""Pixels of which the birth/death update has something to decide."""

from numba import prange

from srt3d_ros.kernels.constants import VOTE_RADIUS
from srt3d_ros.kernels.cpu import field
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO, B, U, aligned, any_of, copy
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel
from srt3d_ros.kernels.cpu.field import is_surface, rise, wrap
from srt3d_ros.kernels.maps import FIELDS, MARGIN

# Offsets in the scratch, for numbers of B pixels.
OWN, OPEN, NUMBER, STRANGE, CARRIED, REACHED = (U(k) * B for k in range(6))


@inline
def _compare(s, state, at, here, surfaces, padded_cols, dx, dy, max_chi2, blur2, period, max_std):
    """Count the surface of a neighbour at (dx, dy), whose depth is at `at`, and open pixels that do not know it."""
    for x in range(B):
        std = state[at + field.STD * padded_cols + x]
        there = ONE if is_surface(state[at + field.INTENSITY * padded_cols + x], std, max_std) else ZERO
        s[NUMBER + x] += there
        s[STRANGE + x] = there
        s[REACHED + x] = max_chi2 * std * std + blur2 + blur2
        s[CARRIED + x] = state[at + field.DEPTH * padded_cols + x] - rise(
            state[at + field.SLOPE_COL * padded_cols + x], state[at + field.SLOPE_ROW * padded_cols + x], dx, dy)
    for k in range(surfaces):
        mine = U(here + k * FIELDS * padded_cols)
        for x in range(B):
            e = wrap(s[CARRIED + x] - state[mine + field.DEPTH * padded_cols + x], period)
            std = state[mine + field.STD * padded_cols + x]
            same = (e * e < s[REACHED + x] + max_chi2 * std * std) & is_surface(
                state[mine + field.INTENSITY * padded_cols + x], std, max_std)
            s[STRANGE + x] = ZERO if same else s[STRANGE + x]
    for x in range(B):
        s[OPEN + x] = max(s[OPEN + x], s[STRANGE + x])


@line
def _find_undecided(s, state, here, surfaces, padded_cols, max_chi2, blur2, period, max_std):
    """Set B numbers from OPEN on in s to 1 where something is to be decided, else 0; from OWN on: own surfaces.

    A pixel is decided if it knows all surfaces of the 3 × 3 neighbourhood, and no neighbour that has any has fewer.
    `here` is the index of the first pixel's depth in the flat state.
    """
    for x in range(B):
        s[OWN + x], s[OPEN + x] = ZERO, ZERO
    for k in range(surfaces):
        mine = U(here + k * FIELDS * padded_cols)
        for x in range(B):
            intensity, std = state[mine + field.INTENSITY * padded_cols + x], state[mine + field.STD * padded_cols + x]
            s[OWN + x] += ONE if is_surface(intensity, std, max_std) else ZERO
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            if dx == 0 and dy == 0:             # the pixel's own
                continue
            for x in range(B):
                s[NUMBER + x] = ZERO
            for q in range(surfaces):
                at = U(here + (dy * surfaces + q) * FIELDS * padded_cols + dx)
                _compare(s, state, at, here, surfaces, padded_cols, F32(dx), F32(dy), max_chi2, blur2, period, max_std)
            for x in range(B):
                fewer = (s[NUMBER + x] > ZERO) & (s[NUMBER + x] < s[OWN + x])
                s[OPEN + x] = ONE if fewer else s[OPEN + x]


@parallel
def mark_undecided(exposure, spreads, changed, before, own_before, after, own_after, changes, max_chi2, blur2, period,
                    max_std, undecided):
    """Write 1 where something is to be decided, else 0; and the surfaces as they are."""
    padded_rows, surfaces, fields, padded_cols = before.shape
    state = before.reshape(-1)
    for turn in prange(padded_rows - 2 * MARGIN):
        i = turn + MARGIN
        for k in range(surfaces):
            for f in range(fields):
                copy(before[i, k, f], after[i, k, f])
            copy(own_before[i, k], own_after[i, k])
        for j in range(padded_cols):
            changes[i, j], undecided[i, j] = 0, False
        if spreads and not any_of(changed[i - VOTE_RADIUS:i + VOTE_RADIUS + 1]):
            continue
        s = aligned(6 * int(B))
        for first in range(MARGIN, padded_cols - MARGIN, int(B)):
            _find_undecided(s, state, i * surfaces * FIELDS * padded_cols + first, surfaces, U(padded_cols), max_chi2,
                            blur2, period, max_std)
            for x in range(B):
                j = first + int(x)
                if s[OPEN + x] > ZERO and exposure[i, j] > ZERO:
                    around = changed[i - VOTE_RADIUS:i + VOTE_RADIUS + 1, j - VOTE_RADIUS:j + VOTE_RADIUS + 1]
                    undecided[i, j] = not spreads or (s[OWN + x] < surfaces and any_of(around))
