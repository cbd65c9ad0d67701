"""What the other surfaces of a pixel leave of its sketch: `residual` of `kernels.api`."""

import numpy as np

from srt3d_ros.kernels.maps import DEPTH, VALUE
from srt3d_ros.kernels.reference.arithmetic import expected, pixel_z


def residual(frame, state, terms, layer, scratch=None):
    """Loop over pixels."""
    m = len(frame.energy)
    out = np.zeros(frame.matched.shape)
    for i, j in np.argwhere(frame.exposure > 0):
        z = pixel_z(frame.matched, i, j)
        for k in range(state.shape[1]):
            if k != layer:
                shown = max(terms[i, k, VALUE, j], 0) / frame.total_energy
                z = z - expected(shown, float(state[i, k, DEPTH, j]), frame)
        out[i, :m, j], out[i, m:, j] = z.real, z.imag
    return out
