"""Intensity of every point from the photons of its own pixel."""

import numpy as np
from numba import prange

from srt3d_ros.core.layout import DEPTH, INTENSITY
from srt3d_ros.kernels.cpu.arithmetic import TINY, ZERO, parallel, sincos


@parallel
def _own_intensity(matched, exposure, energy, cycles, state, out):
    tall, surfaces, _, wide = state.shape
    m = len(energy)
    total = energy.sum()
    for i in prange(tall):
        for k in range(surfaces):
            for j in range(wide):
                out[i, k, j] = ZERO
                if state[i, k, INTENSITY, j] <= ZERO:
                    continue
                value = ZERO
                for l in range(m):
                    sine, cosine = sincos(cycles[l] * state[i, k, DEPTH, j])
                    value += matched[i, l, j] * cosine + matched[i, m + l, j] * sine
                    for o in range(surfaces):
                        if o != k and state[i, o, INTENSITY, j] > ZERO:
                            _, apart = sincos(cycles[l] * (state[i, o, DEPTH, j] - state[i, k, DEPTH, j]))
                            value -= state[i, o, INTENSITY, j] * exposure[i, j] * energy[l] * apart
                out[i, k, j] = value / (total * max(exposure[i, j], TINY))


def own_intensity(data, state):
    """Least-squares intensity of each point from its own pixel alone, the pixel's other surfaces taken out.

    Returns:
        float32 [rows', K, cols'], 0 where there is no point.
    """
    out = np.empty((state.shape[0], state.shape[1], state.shape[3]), np.float32)
    _own_intensity(data.matched, data.exposure, data.energy, data.cycles, state, out)
    return out
