"""What the known surfaces of a pixel leave of its sketch."""

from numba import prange

from srt3d_ros.kernels.cpu.arithmetic import ZERO, sincos, total_of
from srt3d_ros.kernels.cpu.compiling import parallel
from srt3d_ros.kernels.cpu.scratch import borrow
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, VALUE


@parallel
def _residual(matched, energy, bin_frequencies, state, terms, layer, rest):
    padded_rows, surfaces, _, padded_cols = state.shape
    m, total = len(energy), total_of(energy)
    for i in prange(padded_rows):
        for l in range(2 * m):
            for j in range(padded_cols):
                rest[i, l, j] = matched[i, l, j]
        for j in range(padded_cols):
            for k in range(surfaces):
                if k != layer and state[i, k, INTENSITY, j] > ZERO:
                    signal = max(terms[i, k, VALUE, j], ZERO) / total
                    for l in range(m):
                        sine, cosine = sincos(bin_frequencies[l] * state[i, k, DEPTH, j])
                        rest[i, l, j] -= signal * energy[l] * cosine
                        rest[i, m + l, j] -= signal * energy[l] * sine


def residual(frame, state, terms, layer, scratch=None):
    """Rows in parallel."""
    rest = borrow(scratch, "residual", frame.matched.shape)
    _residual(frame.matched, frame.energy, frame.bin_frequencies, state, terms, layer, rest)
    return rest
