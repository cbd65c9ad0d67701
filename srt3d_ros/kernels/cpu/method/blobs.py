"""Remove blobs: surfaces of which no pool is clearly better than chance.

A chance maximum of the wide window grows by pixels that do not support it, so its score stays about what it started
with. The score of a surface grows with its pixels. Points stay if one with score / c(t) of `enough` is within the reach
of the last window (a square).
"""

from math import ceil

from numba import float32, prange

from srt3d_ros.kernels.constants import REACH, WINDOWS
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO
from srt3d_ros.kernels.cpu.compiling import line, parallel
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.cpu.method.likelihood import noise_at
from srt3d_ros.kernels.cpu.vectors import full, load, store, where
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, LANES, MARGIN, SCORE

RADIUS = ceil(REACH * WINDOWS[-1].sigma)


@line
def _find_sure(i, frame, state, enough, sure):
    for j in range(MARGIN, state.shape[3] - MARGIN, LANES):
        is_sure = full(False)
        for k in range(state.shape[1]):
            score = load(state, i, k, SCORE, j) / noise_at(frame, load(state, i, k, DEPTH, j))
            is_sure |= (load(state, i, k, INTENSITY, j) > ZERO) & (score >= enough)
        store(sure, i, j, where(is_sure, ONE, ZERO))


@line
def _look_down(i, sure, near):
    """Write the highest of the column within RADIUS."""
    for j in range(MARGIN, sure.shape[1] - MARGIN, LANES):
        highest = full(ZERO)
        for a in range(i - RADIUS, i + RADIUS + 1):
            highest = max(highest, load(sure, a, j))
        store(near, i, j, highest)


@line
def _keep_near(i, near, state):
    for j in range(MARGIN, state.shape[3] - MARGIN, LANES):
        highest = full(ZERO)
        for b in range(j - RADIUS, j + RADIUS + 1):
            highest = max(highest, load(near, i, b))
        for k in range(state.shape[1]):
            store(state, i, k, INTENSITY, j, highest * load(state, i, k, INTENSITY, j))


@parallel
def _drop_blobs(frame: Frame, state: float32[:, :, :, ::1], enough: float32, sure: float32[:, ::1],
                near: float32[:, ::1]):
    rows = len(state) - 2 * MARGIN
    for turn in prange(rows):
        _find_sure(turn + MARGIN, frame, state, enough, sure)
    for turn in prange(rows):
        _look_down(turn + MARGIN, sure, near)
    for turn in prange(rows):
        _keep_near(turn + MARGIN, near, state)


def drop_blobs(work, frame, state, enough):
    _drop_blobs(Frame.of(frame), state, F32(enough), work.blank, work.had)
