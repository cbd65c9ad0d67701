"""Find the pixels in which the birth/death update has something to decide.

A pixel is decided if each surface of its 3 × 3 neighbourhood agrees with one of its own, e² < max_chi2 (std² + std_q²)
+ 2 δ² with e their distance at the pixel, and no neighbour that has surfaces has fewer than it.
"""

import numpy as np
from numba import boolean, float32, int32, prange

from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO, B, U, aligned, any_of
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel, serial
from srt3d_ros.kernels.cpu.method import field
from srt3d_ros.kernels.cpu.method.field import is_surface, rise, wrap
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.maps import BLOCK, MARGIN

# Of BLOCK pixels: their surfaces, whether something is to be decided (1 or 0), and the surfaces of a neighbour; of the
# neighbour's surface that is compared: whether it is unknown to the pixel (1 or 0), its depth there and its tolerance.
PIXELS = np.dtype([(name, np.float32, BLOCK) for name in (
    "surfaces", "open", "around", "unknown", "depth", "tolerance")])
PIXELS_SIZE = PIXELS.itemsize // 4


@inline
def _compare(pixels, there, here, offset, max_chi2, frame):
    """Count surfaces of a neighbour, [FIELDS, cols'], and open the pixels that know none like them.

    `here` are the pixels' own, [K, FIELDS, cols']; `offset` is (first column, dx, dy).
    """
    col, dx, dy = offset
    near, first = U(col + dx), U(col)
    blur2 = frame.resolution * frame.resolution
    for x in range(B):
        std = there[field.STD, near + x]
        found = ONE if is_surface(there[field.INTENSITY, near + x], std, frame.max_std) else ZERO
        pixels.around[x] += found
        pixels.unknown[x] = found
        pixels.tolerance[x] = max_chi2 * std * std + blur2 + blur2
        pixels.depth[x] = there[field.DEPTH, near + x] - rise(
            there[field.SLOPE_COL, near + x], there[field.SLOPE_ROW, near + x], F32(dx), F32(dy))
    for k in range(U(len(here))):
        own = here[k]
        for x in range(B):
            e = wrap(pixels.depth[x] - own[field.DEPTH, first + x], frame.period)
            std = own[field.STD, first + x]
            same = (e * e < pixels.tolerance[x] + max_chi2 * std * std) & is_surface(
                own[field.INTENSITY, first + x], std, frame.max_std)
            pixels.unknown[x] = ZERO if same else pixels.unknown[x]
    for x in range(B):
        pixels.open[x] = max(pixels.open[x], pixels.unknown[x])


@line
def _find(pixels, state, row, col, max_chi2, frame, grows):
    """Set `open` to 1 where something is to be decided in the BLOCK pixels from (row, col) on, else to 0.

    If surfaces grow and all of the pixels have K of them, nothing is.
    """
    here, first, fewest = state[row], U(col), F32(state.shape[1])
    for x in range(B):
        pixels.surfaces[x] = pixels.open[x] = ZERO
    for k in range(U(len(here))):
        own = here[k]
        for x in range(B):
            found = is_surface(own[field.INTENSITY, first + x], own[field.STD, first + x], frame.max_std)
            pixels.surfaces[x] += ONE if found else ZERO
    for x in range(B):
        fewest = min(fewest, pixels.surfaces[x])
    if grows and fewest == F32(len(here)):
        return
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            if dx == 0 and dy == 0:
                continue
            for x in range(B):
                pixels.around[x] = ZERO
            for q in range(U(len(here))):
                _compare(pixels, state[row + dy, q], here, (col, dx, dy), max_chi2, frame)
            for x in range(B):
                fewer = (pixels.around[x] > ZERO) & (pixels.around[x] < pixels.surfaces[x])
                pixels.open[x] = ONE if fewer else pixels.open[x]


@parallel
def _list_rows(frame: Frame, state: float32[:, :, :, ::1], max_chi2: float32, near: boolean[:, ::1], grows: boolean,
               cols: int32[:, ::1], number: int32[::1]):
    """List the columns of each row's undecided pixels, and how many they are."""
    rows, surfaces, _, padded_cols = state.shape
    for turn in prange(rows - 2 * MARGIN):
        row, found, scratch = turn + MARGIN, 0, aligned(PIXELS_SIZE).view(PIXELS)
        for first in range(MARGIN, padded_cols - MARGIN, BLOCK):
            pixels = scratch[0]                 # here, for a record does not keep the memory of its array
            if not any_of(near[row:row + 1, first:first + BLOCK]):
                continue
            _find(pixels, state, row, first, max_chi2, frame, grows)
            for x in range(B):
                col = first + int(x)
                has_room = pixels.surfaces[x] < F32(surfaces) or not grows
                if near[row, col] and has_room and pixels.open[x] > ZERO and frame.exposure[row, col] > ZERO:
                    cols[row, found] = col
                    found += 1
        number[row] = found


@serial
def _join_rows(cols: int32[:, ::1], number: int32[::1], pixels: int32[::1]):
    """Join the lists of the rows, as indices of padded maps; returns how many pixels there are."""
    found = 0
    for i in range(len(cols)):
        for n in range(number[i]):
            pixels[found] = i * cols.shape[1] + cols[i, n]
            found += 1
    return found


def list_undecided(frame, state, max_chi2, near, grows):
    """The used pixels that have something to decide, int32 [N], among those `near` a change, bool [rows', cols'].

    If surfaces grow (`grows`), only those with fewer than K surfaces.
    """
    cols, number = np.empty(near.shape, np.int32), np.zeros(len(near), np.int32)
    pixels = np.empty(near.size, np.int32)
    _list_rows(frame, state, max_chi2, near, grows, cols, number)
    return pixels[:_join_rows(cols, number, pixels)]
