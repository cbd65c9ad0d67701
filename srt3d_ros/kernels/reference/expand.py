"""The data term of every point, to second order at its depth: `expand` of `kernels.api`."""

import numpy as np

from srt3d_ros.kernels.maps import (
    COUNTS,
    CURVATURE,
    DEPTH,
    EXPOSURE,
    GRADIENT,
    INTENSITY,
    SQUARES,
    TERMS,
    VALUE,
)
from srt3d_ros.kernels.reference.arithmetic import angular, expected, pixel_z


def expand(frame, state, scratch=None):
    """Loop over points."""
    state, omega = state.astype(np.float64), angular(frame)
    terms = np.zeros((*state.shape[:2], TERMS, state.shape[3]))
    for i, k, j in np.argwhere(state[:, :, INTENSITY] > 0):
        z = pixel_z(frame.matched, i, j)
        for other in np.delete(state[i, :, :, j], k, axis=0):
            z = z - expected(frame.exposure[i, j] * other[INTENSITY], other[DEPTH], frame)
        along = z * np.exp(-1j * omega * state[i, k, DEPTH, j])
        terms[i, k, VALUE, j] = along.real.sum()
        terms[i, k, GRADIENT, j] = (omega * along.imag).sum()
        terms[i, k, CURVATURE, j] = (omega**2 * along.real).sum()
        terms[i, k, [SQUARES, COUNTS], j] = frame.counts[i, j]
        terms[i, k, EXPOSURE, j] = frame.exposure[i, j]
    return terms
