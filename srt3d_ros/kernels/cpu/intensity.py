"""Intensity of every point from the photons of its own pixel."""

import numpy as np
from numba import prange

from srt3d_ros.core.layout import INTENSITY
from srt3d_ros.kernels.cpu.arithmetic import TINY, ZERO, total_of
from srt3d_ros.kernels.cpu.compiling import parallel
from srt3d_ros.kernels.cpu.evidence import own_response


@parallel
def _own_intensity(matched, exposure, energy, cycles, state, out):
    tall, surfaces, _, wide = state.shape
    total = total_of(energy)
    for i in prange(tall):
        response = np.empty(wide, np.float32)
        for k in range(surfaces):
            own_response(matched, exposure, energy, cycles, state, i, k, response)
            for j in range(wide):
                share = response[j] / (total * max(exposure[i, j], TINY))
                out[i, k, j] = share if state[i, k, INTENSITY, j] > ZERO else ZERO


def own_intensity(data, state, out=None):
    """Least-squares intensity of each point from its own pixel alone, the pixel's other surfaces taken out.

    Returns:
        float32 [rows', K, cols'], 0 where there is no point.
    """
    if out is None:
        out = np.empty((state.shape[0], state.shape[1], state.shape[3]), np.float32)
    _own_intensity(data.matched, data.exposure, data.energy, data.cycles, state, out)
    return out
