"""How far surfaces leave the tangent planes along which their points pool photons."""

import numpy as np
from numba import prange

from srt3d_ros.core.layout import ASTRAY, DEPTH, INTENSITY, MARGIN, SLOPE_COL, SLOPE_ROW, STD
from srt3d_ros.kernels.constants import STEP
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, TINY, ZERO, parallel, wrap


@parallel
def _relief(state, near, gate, num_bins, out):
    tall, surfaces, _, wide = state.shape
    period, radius, astray = F32(num_bins), len(near) - 1, F32(ASTRAY * num_bins)
    for row in prange(tall - 2 * MARGIN):
        i = row + MARGIN
        for k in range(surfaces):
            t, col, down, std = state[i, k, DEPTH], state[i, k, SLOPE_COL], state[i, k, SLOPE_ROW], state[i, k, STD]
            weight, square = np.zeros(wide, np.float32), np.zeros(wide, np.float32)
            for di in range(-radius, radius + 1, STEP):
                for dj in range(-radius, radius + 1, STEP):
                    by_distance = near[abs(di)] * near[abs(dj)] if di != 0 or dj != 0 else ZERO
                    for q in range(surfaces):
                        there = state[i + di, q]
                        for j in range(MARGIN, wide - MARGIN):
                            e = wrap(there[DEPTH, j + dj] - t[j] - col[j] * F32(dj) - down[j] * F32(di), period)
                            noisy = there[STD, j + dj] * there[STD, j + dj] + std[j] * std[j]
                            close = max(ONE - e * e / (gate * noisy + TINY), ZERO)
                            lit = there[INTENSITY, j + dj] > ZERO and there[STD, j + dj] < astray
                            w = by_distance * close * close if lit else ZERO
                            weight[j] += w
                            square[j] += w * e * e
            for j in range(MARGIN, wide - MARGIN):
                out[i, k, j] = np.sqrt(square[j] / (weight[j] + TINY)) if state[i, k, INTENSITY, j] > ZERO else ZERO


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
    _relief(state, near, F32(gate), num_bins, out)
    return out
