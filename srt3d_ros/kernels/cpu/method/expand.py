"""Data terms of every point: v = Σ_l Re(z_l exp(−i ω_l t)), its slope and its curvature, less the other surfaces."""

import numpy as np
from numba import float32, prange

from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO, sincos
from srt3d_ros.kernels.cpu.compiling import parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.method import field
from srt3d_ros.kernels.maps import MARGIN, TERMS

TURN = F32(2 * np.pi)


@parallel
def _expand(matched: float32[:, :, ::1], counts: float32[:, ::1], exposure: float32[:, ::1], energy: float32[::1],
            bin_frequencies: float32[::1], state: float32[:, :, :, ::1], terms: float32[:, :, :, ::1]):
    padded_rows, surfaces, _, padded_cols = state.shape
    m = len(energy)
    for row in prange(padded_rows - 2 * MARGIN):
        i = row + MARGIN
        v, g, c = (np.empty(padded_cols, np.float32), np.empty(padded_cols, np.float32),
                   np.empty(padded_cols, np.float32))
        for k in range(surfaces):
            v[:], g[:], c[:] = ZERO, ZERO, ZERO
            depth = state[i, k, field.DEPTH]
            for l in range(m):
                frequency, omega = bin_frequencies[l], TURN * bin_frequencies[l]
                real, imaginary = matched[i, l], matched[i, m + l]
                for j in range(padded_cols):
                    sine, cosine = sincos(frequency * depth[j])
                    along = real[j] * cosine + imaginary[j] * sine
                    v[j] += along
                    g[j] += omega * (imaginary[j] * cosine - real[j] * sine)
                    c[j] += omega * omega * along
            for o in range(surfaces):
                if o != k:
                    other, strength = state[i, o, field.DEPTH], state[i, o, field.INTENSITY]
                    for l in range(m):
                        frequency, omega, share = bin_frequencies[l], TURN * bin_frequencies[l], energy[l]
                        for j in range(padded_cols):
                            sine, cosine = sincos(frequency * (other[j] - depth[j]))
                            known = strength[j] * exposure[i, j] * share
                            v[j] -= known * cosine
                            g[j] -= omega * known * sine
                            c[j] -= omega * omega * known * cosine
            for j in range(padded_cols):
                seen = ONE if state[i, k, field.INTENSITY, j] > ZERO else ZERO
                terms[i, k, field.VALUE, j], terms[i, k, field.GRADIENT, j] = seen * v[j], seen * g[j]
                terms[i, k, field.CURVATURE, j] = seen * c[j]
                terms[i, k, field.SQUARES, j] = seen * counts[i, j]
                terms[i, k, field.COUNTS, j] = seen * counts[i, j]
                terms[i, k, field.EXPOSURE, j] = seen * exposure[i, j]


def expand(frame, state):
    """As the contract; rows are computed with their margins, since numba does not vectorise loops that begin there."""
    padded_rows, surfaces, _, padded_cols = state.shape
    terms = borrow("terms", (padded_rows, surfaces, TERMS, padded_cols))
    _expand(frame.matched, frame.counts, frame.exposure, frame.energy, frame.bin_frequencies, state, terms)
    return terms
