"""What the other surfaces of a pixel leave of its sketch."""

import numpy as np
from numba import prange

from srt3d_ros.core import layout
from srt3d_ros.kernels.cpu.arithmetic import ZERO, sincos
from srt3d_ros.kernels.cpu.compiling import parallel
from srt3d_ros.kernels.cpu.intensity import own_intensity
from srt3d_ros.kernels.cpu.scratch import borrow


@parallel
def _explain(matched, exposure, energy, cycles, state, rest):
    tall, surfaces, _, wide = state.shape
    m = len(energy)
    for i in prange(tall):
        for j in range(wide):
            for k in range(surfaces):
                rest[k, i, :, j] = matched[i, :, j]
                for o in range(surfaces):
                    known = state[i, o, layout.INTENSITY, j] * exposure[i, j]
                    if o != k and known > ZERO:
                        for l in range(m):
                            sine, cosine = sincos(cycles[l] * state[i, o, layout.DEPTH, j])
                            rest[k, i, l, j] -= known * energy[l] * cosine
                            rest[k, i, m + l, j] -= known * energy[l] * sine


def explain(data, state):
    """What is left of the pixels' sketches for each of their surfaces when the others are taken out.

    Returns:
        float32 [K, rows', 2m, cols'].
    """
    if state.shape[1] == 1:
        return data.matched[None]
    rest = np.empty((state.shape[1], *data.matched.shape), np.float32)
    _explain(data.matched, data.exposure, data.energy, data.cycles, state, rest)
    return rest


def leave(data, state, layer, scratch=None):
    """What the surfaces before `layer` leave of the pixels' sketches, each as strong as its own pixel shows it.

    With the intensity of its pool instead, too much would be taken from some pixels; then the matched filter responds
    where a surface would give the opposite, half a period away.

    Returns:
        float32 [rows', 2m, cols'].
    """
    known = borrow(scratch, "known", state.shape)
    known[:] = state
    np.maximum(own_intensity(data, state), 0, out=known[:, :, layout.INTENSITY])
    return explain(data, known)[layer]
