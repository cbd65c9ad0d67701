"""Planes of the start: `turn_planes`. `kernels.torch.method.planes` has the equation."""

import numpy as np

from srt3d_ros.kernels.constants import PLANE_RADIUS, PLANE_STEP, PLANE_TURNS, SLANT, TURN_GAIN
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, wrap
from srt3d_ros.kernels.cpu.compiling import each, floats3d, floats4d, inline, line
from srt3d_ros.kernels.cpu.method.frame import AROUND, Frame
from srt3d_ros.kernels.cpu.vectors import fma, full, lanes_of, where
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, SLOPE_COL, SLOPE_ROW

NEVER = np.inf          # a support that no plane has


@line
def _support(i, j, slope_col, slope_row, sharpness, period, state):
    """Σ (1 − sharpness · e²)₊² over the points around, e their depths off the planes; and how many these are."""
    support, most, depth = full(0.0), full(0.0), state[i, 0, DEPTH, j]
    for dy in range(-PLANE_RADIUS, PLANE_RADIUS + 1, PLANE_STEP):
        for dx in range(-PLANE_RADIUS, PLANE_RADIUS + 1, PLANE_STEP):
            if dy != 0 or dx != 0:
                plane = fma(slope_col, dx, fma(slope_row, dy, depth))
                e = wrap(state[i + dy, 0, DEPTH, j + dx] - plane, period)
                same = max(1 - e * e * sharpness, 0)
                there = state[i + dy, 0, INTENSITY, j + dx] > 0
                support += where(there, same * same, 0)
                most += where(there, 1, 0)
    return support, most


@inline
def _rise(i, j, down, right, own, period, state):
    """Slope to the point so many pixels along one axis, and whether there is one; for 0 pixels, the own one."""
    slope, there = own, full(True)
    if down != 0 or right != 0:
        there = state[i + down, 0, INTENSITY, j + right] > 0
        apart = state[i + down, 0, DEPTH, j + right] - state[i, 0, DEPTH, j]
        slope = wrap(apart, period) / (down + right)
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
            slope_col, slope_row = state[row, 0, SLOPE_COL, col], state[row, 0, SLOPE_ROW, col]
            there = state[row, 0, INTENSITY, col] > 0
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


def _find(i, j, frame: Frame, state: floats4d, turned: floats3d):
    sharpness, period = ONE / (F32(SLANT) * frame.resolution)**2, frame.period
    slope_col, slope_row = state[i, 0, SLOPE_COL, j], state[i, 0, SLOPE_ROW, j]
    own, most = _support(i, j, slope_col, slope_row, sharpness, period, state)
    least = where(state[i, 0, INTENSITY, j] > 0, TURN_GAIN * own, NEVER)
    if lanes_of(least < most) != 0:
        slope_col, slope_row = _turn(i, j, slope_col, slope_row, least, most, sharpness, period, state)
    turned[i, 0, j], turned[i, 1, j] = slope_col, slope_row


def _take(i, j, turned: floats3d, state: floats4d):
    state[i, 0, SLOPE_COL, j], state[i, 0, SLOPE_ROW, j] = turned[i, 0, j], turned[i, 1, j]


_turn_planes = each(_find, _take)


def turn_planes(work, frame, state):
    for _ in range(PLANE_TURNS):
        _turn_planes(frame, state, work.map("turned", 2))
