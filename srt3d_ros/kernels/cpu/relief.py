"""How far surfaces leave the tangent planes along which their points pool photons."""

import numpy as np
from numba import prange

from srt3d_ros.core.layout import ASTRAY, BLOCK, FIELDS, MARGIN
from srt3d_ros.kernels.constants import STEP
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, TINY, ZERO, aligned, wrap
from srt3d_ros.kernels.cpu.compiling import line, parallel
from srt3d_ros.kernels.cpu.fields import DEPTH, INTENSITY, SLOPE_COL, SLOPE_ROW, STD, B, U

PLANE, WEIGHT, SQUARE = (U(k * BLOCK) for k in range(3))         # offsets into the scratch


@line
def _compare(s, state, point, there, wide, dy, dx, by_distance, gate, period, astray):
    """Add the surfaces of the neighbours at (dy, dx) to the sums of BLOCK points."""
    for x in range(B):
        s[PLANE + x] = state[point + DEPTH * wide + x] + state[point + SLOPE_COL * wide + x] * dx
        s[PLANE + x] += state[point + SLOPE_ROW * wide + x] * dy
    for x in range(B):
        e = wrap(state[there + DEPTH * wide + x] - s[PLANE + x], period)
        far, near = state[there + STD * wide + x], state[point + STD * wide + x]
        close = max(ONE - e * e / (gate * (far * far + near * near) + TINY), ZERO)
        lit = (state[there + INTENSITY * wide + x] > ZERO) & (far < astray)
        w = by_distance * close * close if lit else ZERO
        s[WEIGHT + x] += w
        s[SQUARE + x] += w * e * e


@parallel
def _relief(state, shape, near, gate, num_bins, out):
    tall, surfaces, _, wide = shape
    period, radius, astray = F32(num_bins), len(near) - 1, F32(ASTRAY * num_bins)
    for row in prange(tall - 2 * MARGIN):
        i = row + MARGIN
        s = aligned(3 * BLOCK)
        for j in range(MARGIN, wide - MARGIN, BLOCK):
            for k in range(surfaces):
                point = U((i * surfaces + k) * FIELDS * wide + j)
                for x in range(2 * B):
                    s[WEIGHT + x] = ZERO
                for di in range(-radius, radius + 1, STEP):
                    for dj in range(-radius, radius + 1, STEP):
                        if di != 0 or dj != 0:
                            for q in range(surfaces):
                                there = U(((i + di) * surfaces + q) * FIELDS * wide + j + dj)
                                _compare(s, state, point, there, U(wide), F32(di), F32(dj),
                                         near[abs(di)] * near[abs(dj)], gate, period, astray)
                for x in range(BLOCK):
                    there = state[point + INTENSITY * U(wide) + U(x)] > ZERO
                    mean = s[SQUARE + U(x)] / (s[WEIGHT + U(x)] + TINY)
                    out[i, k, j + x] = np.sqrt(mean) if there else ZERO


def relief(state, window, radius, gate, num_bins, out=None):
    """Root mean square distance of the neighbours' depths from each point's tangent plane, bins.

    A pool along a plane gives the depth of the plane: where the surface bends or is rough, it is wrong by about this.

    Args:
        state: float32 [rows', K, FIELDS, cols'].
        window: σ of the neighbours' weights, pixels.
        radius: of the neighbourhood, pixels, even, at most MARGIN.
        gate: as in `descend`.
        num_bins: T.

    Returns:
        float32 [rows', K, cols'], 0 where there is no point.
    """
    near = np.exp(-np.arange(radius + 1)**2 / (2 * window**2)).astype(np.float32)
    if out is None:
        out = np.zeros((state.shape[0], state.shape[1], state.shape[3]), np.float32)
    _relief(state.reshape(-1), state.shape, near, F32(gate), num_bins, out)
    return out
