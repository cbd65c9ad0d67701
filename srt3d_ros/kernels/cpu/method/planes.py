"""Planes of the start: `turn_planes`. `kernels.torch.method.planes` has the equation."""

import numpy as np
from numba import prange

from srt3d_ros.kernels.constants import PLANE_RADIUS, PLANE_STEP, SLANT, TURN_GAIN
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO, agreement, wrap
from srt3d_ros.kernels.cpu.compiling import floats3d, floats4d, inline, line, parallel
from srt3d_ros.kernels.cpu.method.frame import Frame, columns
from srt3d_ros.kernels.cpu.vectors import fma, full, lanes_of, load, store, where
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, MARGIN, SLOPE_COL, SLOPE_ROW

NEVER = F32(np.inf)     # a support that no plane has
GAIN, SLOPES = F32(TURN_GAIN), (SLOPE_COL, SLOPE_ROW)


@line
def _support(place, slope_col, slope_row, tolerance, period, state):
    """Σ (1 − e² / tolerance)₊² over the points around, e their depths off the planes; and how many these are."""
    (i, j), support, most = place, full(ZERO), full(ZERO)
    depth = load(state, i, 0, DEPTH, j)
    for dy in range(-PLANE_RADIUS, PLANE_RADIUS + 1, PLANE_STEP):
        for dx in range(-PLANE_RADIUS, PLANE_RADIUS + 1, PLANE_STEP):
            if dy != 0 or dx != 0:
                plane = fma(slope_col, F32(dx), fma(slope_row, F32(dy), depth))
                same = agreement(wrap(load(state, i + dy, 0, DEPTH, j + dx) - plane, period), tolerance)
                there = load(state, i + dy, 0, INTENSITY, j + dx) > ZERO
                support += where(there, same * same, ZERO)
                most += where(there, ONE, ZERO)
    return support, most


@inline
def _rise(axis, apart, own, place, period, state):
    """Slope along an axis to the point so many pixels apart, and whether there is one; for 0 pixels, the own one."""
    (i, j), there = place, full(True)
    slope = own
    if apart != 0:
        row, col = i + axis * apart, j + (1 - axis) * apart
        there = load(state, row, 0, INTENSITY, col) > ZERO
        slope = wrap(load(state, row, 0, DEPTH, col) - load(state, i, 0, DEPTH, j), period) / F32(apart)
    return slope, there


@line
def _turn(place, own, least, tolerance, period, state):
    """The slopes with the most support, of those of the planes around and of those to points around."""
    (i, j), (best_col, best_row) = place, own
    for down in range(-1, 2):
        for right in range(-1, 2):
            if down == 0 and right == 0:        # its own plane, both times
                continue
            for handed_on in (True, False):
                if handed_on:
                    row, col = i + down * PLANE_STEP, j + right * PLANE_STEP
                    there = load(state, row, 0, INTENSITY, col) > ZERO
                    slope_col, slope_row = load(state, row, 0, SLOPE_COL, col), load(state, row, 0, SLOPE_ROW, col)
                else:
                    slope_col, beside = _rise(0, right * PLANE_RADIUS, own[0], place, period, state)
                    slope_row, below = _rise(1, down * PLANE_RADIUS, own[1], place, period, state)
                    there = beside & below
                support, _ = _support(place, slope_col, slope_row, tolerance, period, state)
                better = there & (support > least)
                least = where(better, support, least)
                best_col, best_row = where(better, slope_col, best_col), where(better, slope_row, best_row)
    return best_col, best_row


@parallel
def _turn_planes(frame: Frame, state: floats4d, turned: floats3d):
    tolerance = (F32(SLANT) * frame.resolution)**2
    for i in prange(MARGIN, len(state) - MARGIN):
        for j in columns(state):
            slope_col, slope_row = load(state, i, 0, SLOPE_COL, j), load(state, i, 0, SLOPE_ROW, j)
            own, most = _support((i, j), slope_col, slope_row, tolerance, frame.period, state)
            least = where(load(state, i, 0, INTENSITY, j) > ZERO, GAIN * own, NEVER)
            if lanes_of(least < most) != 0:
                slope_col, slope_row = _turn((i, j), (slope_col, slope_row), least, tolerance, frame.period, state)
            store(turned, i, 0, j, slope_col)
            store(turned, i, 1, j, slope_row)
    for i in prange(MARGIN, len(state) - MARGIN):
        for j in columns(state):
            for axis in range(2):
                store(state, i, 0, SLOPES[axis], j, load(turned, i, axis, j))


def turn_planes(work, frame, state):
    _turn_planes(Frame.of(frame), state, work.rim)
