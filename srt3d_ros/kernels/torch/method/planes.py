"""Planes of the start, by the depths around."""

import itertools

import torch

from srt3d_ros.kernels.constants import PLANE_RADIUS, PLANE_STEP, PLANE_TURNS, SLANT, TURN_GAIN
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, SLOPE_COL, SLOPE_ROW
from srt3d_ros.kernels.torch.arithmetic import agreement, wrap
from srt3d_ros.kernels.torch.fusing import fused
from srt3d_ros.kernels.torch.method.windows import images, neighbours, offsets


def turn_planes(frame, state) -> None:
    """Turn the planes of first surfaces to what the depths around show, in place, PLANE_TURNS times.

    A window finds a surface that is steeper or flatter than itself, too, but gives it its own slopes, and neighbours
    that are not on a point's plane share no photons with it. The support of a plane through a point is

        Σ_q (1 − e_q² / (SLANT δ)²)₊²,    e_q = wrap(t_q − t − slopes · (dx, dy)),

    over the points q at the other places of a grid of PLANE_STEP within PLANE_RADIUS. A point takes the slopes with the
    most support, of the planes PLANE_STEP around it, and of those through points PLANE_RADIUS beside, above and below
    it, if that is more than TURN_GAIN times the support of its own.
    """
    for _ in range(PLANE_TURNS):
        _turn(frame, state)


@fused
def _turn(frame, state) -> None:
    point, around = images(frame, state)[0], neighbours(frame, state[:, 0], PLANE_RADIUS, PLANE_STEP)
    dy, dx = offsets(PLANE_RADIUS, point, PLANE_STEP)
    own, period = (point[SLOPE_COL], point[SLOPE_ROW]), frame.num_bins
    there, apart = around[:, INTENSITY] > 0, wrap(around[:, DEPTH] - point[DEPTH], period)
    counted = there & ((dx != 0) | (dy != 0))

    def support(slope_col, slope_row):
        e = wrap(apart - slope_col * dx - slope_row * dy, period)
        return (counted * agreement(e, (SLANT * frame.resolution_bins)**2)**2).sum(0)

    least, (best_col, best_row), last = TURN_GAIN * support(*own), own, 2 * PLANE_RADIUS // PLANE_STEP
    middle = last // 2

    def rise(side, place, slope):
        return (slope, point[INTENSITY] > 0) if side == 0 else (apart[place] / (side * PLANE_RADIUS), there[place])

    for down, right in (side for side in itertools.product((-1, 0, 1), repeat=2) if any(side)):
        near = (middle + down) * (last + 1) + middle + right
        slope_col, beside = rise(right, middle * (last + 1) + middle + right * middle, own[0])
        slope_row, below = rise(down, (middle + down * middle) * (last + 1) + middle, own[1])
        for slopes, is_there in (((around[near, SLOPE_COL], around[near, SLOPE_ROW]), there[near]),
                                 ((slope_col, slope_row), beside & below)):
            value = support(*slopes)
            better = is_there & (value > least)
            least = torch.where(better, value, least)
            best_col, best_row = (torch.where(better, new, old) for new, old in zip(slopes, (best_col, best_row)))
    for field, best in zip((SLOPE_COL, SLOPE_ROW), (best_col, best_row)):
        point[field].copy_(torch.where(point[INTENSITY] > 0, best, point[field]))
