"""Planes of the start: `turn_planes`. `kernels.torch.method.planes` has the equation."""

import numpy as np
from numba import prange

from srt3d_ros.kernels.constants import PLANE_RADIUS, PLANE_STEP, PLANE_TURNS, SLANT, TURN_GAIN
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO, wrap
from srt3d_ros.kernels.cpu.compiling import floats3d, floats4d, inline, line, parallel
from srt3d_ros.kernels.cpu.method.frame import AROUND, Frame, columns
from srt3d_ros.kernels.cpu.vectors import fma, full, lanes_of, load, store, where
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, MARGIN, SLOPE_COL, SLOPE_ROW

NEVER = F32(np.inf)     # a support that no plane has
GAIN = F32(TURN_GAIN)


@line
def _support(i, j, slope_col, slope_row, sharpness, period, state):
    """Σ (1 − sharpness · e²)₊² over the points around, e their depths off the planes; and how many these are."""
    support, most, depth = full(ZERO), full(ZERO), load(state, i, 0, DEPTH, j)
    for dy in range(-PLANE_RADIUS, PLANE_RADIUS + 1, PLANE_STEP):
        for dx in range(-PLANE_RADIUS, PLANE_RADIUS + 1, PLANE_STEP):
            if dy != 0 or dx != 0:
                plane = fma(slope_col, F32(dx), fma(slope_row, F32(dy), depth))
                e = wrap(load(state, i + dy, 0, DEPTH, j + dx) - plane, period)
                same = max(ONE - e * e * sharpness, ZERO)
                there = load(state, i + dy, 0, INTENSITY, j + dx) > ZERO
                support += where(there, same * same, ZERO)
                most += where(there, ONE, ZERO)
    return support, most


@inline
def _rise(i, j, down, right, own, period, state):
    """Slope to the point so many pixels along one axis, and whether there is one; for 0 pixels, the own one."""
    slope, there = own, full(True)
    if down != 0 or right != 0:
        there = load(state, i + down, 0, INTENSITY, j + right) > ZERO
        apart = load(state, i + down, 0, DEPTH, j + right) - load(state, i, 0, DEPTH, j)
        slope = wrap(apart, period) / F32(down + right)
    return slope, there


@line
def _turn(i, j, own_col, own_row, least, most, sharpness, period, state):
    """The slopes with more than the `least` support, of the planes around and of those to points around.

    None has more than `most`, so nearly all candidates can be left out.
    """
    best_col, best_row = own_col, own_row
    for down, right in AROUND:
        for handed_on in (True, False):
            row, col = i + down * PLANE_STEP, j + right * PLANE_STEP
            slope_col, slope_row = load(state, row, 0, SLOPE_COL, col), load(state, row, 0, SLOPE_ROW, col)
            there = load(state, row, 0, INTENSITY, col) > ZERO
            if not handed_on:
                slope_col, beside = _rise(i, j, 0, right * PLANE_RADIUS, own_col, period, state)
                slope_row, below = _rise(i, j, down * PLANE_RADIUS, 0, own_row, period, state)
                there = beside & below
            better = there & (least < most) & ((slope_col != own_col) | (slope_row != own_row))
            if lanes_of(better) != 0:
                support, _ = _support(i, j, slope_col, slope_row, sharpness, period, state)
                better &= support > least
                least = where(better, support, least)
                best_col, best_row = where(better, slope_col, best_col), where(better, slope_row, best_row)
    return best_col, best_row


@parallel
def _turn_planes(frame: Frame, state: floats4d, turned: floats3d):
    sharpness, period = ONE / (F32(SLANT) * frame.resolution)**2, frame.period
    for _ in range(PLANE_TURNS):
        for i in prange(MARGIN, len(state) - MARGIN):
            for j in columns(state):
                slope_col, slope_row = load(state, i, 0, SLOPE_COL, j), load(state, i, 0, SLOPE_ROW, j)
                own, most = _support(i, j, slope_col, slope_row, sharpness, period, state)
                least = where(load(state, i, 0, INTENSITY, j) > ZERO, GAIN * own, NEVER)
                if lanes_of(least < most) != 0:
                    slope_col, slope_row = _turn(i, j, slope_col, slope_row, least, most, sharpness, period, state)
                store(turned, i, 0, j, slope_col)
                store(turned, i, 1, j, slope_row)
        for i in prange(MARGIN, len(state) - MARGIN):
            for j in columns(state):
                store(state, i, 0, SLOPE_COL, j, load(turned, i, 0, j))
                store(state, i, 0, SLOPE_ROW, j, load(turned, i, 1, j))


def turn_planes(work, frame, state):
    _turn_planes(frame, state, work.rim)
