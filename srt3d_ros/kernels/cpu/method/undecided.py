"""Pixels of which the birth/death update has something to decide."""

import numpy as np
from numba import boolean, float32, int32, prange

from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO, B, U, aligned, any_of
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel, serial
from srt3d_ros.kernels.cpu.method import field
from srt3d_ros.kernels.cpu.method.field import is_surface, rise, wrap
from srt3d_ros.kernels.cpu.method.frame import FRAME
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
def _find(s, state, here, surfaces, padded_cols, max_chi2, blur2, period, max_std, grows):
    """Set B numbers from OPEN on in s to 1 where something is to be decided, else 0.

    A pixel is decided if it knows all surfaces of the 3 × 3 neighbourhood, and no neighbour that has any has fewer.
    If it `grows`, B pixels that all have K surfaces are. `here` is the index of the first pixel's depth in the state.
    """
    for x in range(B):
        s[OWN + x], s[OPEN + x] = ZERO, ZERO
    for k in range(surfaces):
        mine = U(here + k * FIELDS * padded_cols)
        for x in range(B):
            intensity, std = state[mine + field.INTENSITY * padded_cols + x], state[mine + field.STD * padded_cols + x]
            s[OWN + x] += ONE if is_surface(intensity, std, max_std) else ZERO
    fewest = s[OWN]
    for x in range(B):
        fewest = min(fewest, s[OWN + x])
    if grows and fewest == F32(surfaces):
        return
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
def _list_rows(frame: FRAME, state: float32[:, :, :, ::1], max_chi2: float32, near: boolean[:, ::1], grows: boolean,
               cols: int32[:, ::1], number: int32[::1]):
    """List the columns of each row's undecided pixels, and how many they are."""
    padded_rows, surfaces, _, padded_cols = state.shape
    flat, blur2 = state.reshape(-1), frame.resolution * frame.resolution
    for turn in prange(padded_rows - 2 * MARGIN):
        i, s, found = turn + MARGIN, aligned(6 * int(B)), 0
        for first in range(MARGIN, padded_cols - MARGIN, int(B)):
            if not any_of(near[i:i + 1, first:first + int(B)]):
                continue
            _find(s, flat, i * surfaces * FIELDS * padded_cols + first, surfaces, U(padded_cols), max_chi2, blur2,
                  frame.period, frame.max_std, grows)
            for x in range(B):
                j = first + int(x)
                has_room = s[OWN + x] < F32(surfaces) or not grows
                if near[i, j] and has_room and s[OPEN + x] > ZERO and frame.exposure[i, j] > ZERO:
                    cols[i, found] = j
                    found += 1
        number[i] = found


@serial
def _join_rows(cols: int32[:, ::1], number: int32[::1], pixels: int32[::1]):
    """Write the rows' lists one after the other, as indices of padded maps, and return how many pixels there are."""
    found = 0
    for i in range(len(cols)):
        for n in range(number[i]):
            pixels[found] = i * cols.shape[1] + cols[i, n]
            found += 1
    return found


def list_undecided(frame, state, max_chi2, near, grows):
    """The used pixels that have something to decide, int32 [N] and more, and N.

    Of those that are `near`, bool [rows', cols'], a change; if it `grows`, only those with fewer than K surfaces.
    """
    cols, number = np.empty(near.shape, np.int32), np.zeros(len(near), np.int32)
    pixels = np.empty(near.size, np.int32)
    _list_rows(frame, state, max_chi2, near, grows, cols, number)
    return pixels[:_join_rows(cols, number, pixels)]
