"""Sketches as the iterations want them, one plane for each part of each frequency, and what known surfaces leave."""

import numpy as np
from numba import prange

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.cpu.arithmetic import ZERO, sincos, total_of
from srt3d_ros.kernels.cpu.compiling import parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, VALUE


def prepare(sums, photons, equaliser, used, taken=None, shown=None):
    """Real and imaginary parts by themselves: a product of complex numbers is rounded otherwise on other processors."""
    rows, cols, m = sums.shape
    padded_rows, padded_cols = maps.padded_shape(rows, cols)
    matched, counts = borrow("matched", (padded_rows, 2 * m, padded_cols)), borrow("counts", (padded_rows, padded_cols))
    re, im, c, d = sums.real, sums.imag, equaliser.real, equaliser.imag
    real, imaginary = np.split(maps.crop(matched, rows, cols), 2, axis=1)
    real[:], imaginary[:] = (re * c - im * d).swapaxes(1, 2), (re * d + im * c).swapaxes(1, 2)
    if taken is not None:
        real -= taken[:, None] * shown.real.swapaxes(1, 2)
        imaginary -= taken[:, None] * shown.imag.swapaxes(1, 2)
    maps.crop(counts, rows, cols)[:] = photons * used
    return matched, counts


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


def residual(frame, state, terms, layer):
    rest = borrow("residual", frame.matched.shape)
    _residual(frame.matched, frame.energy, frame.bin_frequencies, state, terms, layer, rest)
    return rest
