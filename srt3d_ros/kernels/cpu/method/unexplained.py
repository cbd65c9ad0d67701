"""Sums over the pixels of what the points do not explain, from which the background is estimated.

With y_l = g Σ_k r_k exp(i ω_l t_k) and w = b̄ / n̄: of w conj(q_l) (z_l − |ĥ_l|² y_l), of w y_l (real parts before
imaginary ones), of w · own, w · taken, w² n and Σ_l |z_l − |ĥ_l|² y_l|² / |ĥ_l|² n̄. Rows are summed in float32, their
sums in float64.
"""

import numpy as np
from numba import float32, prange

from srt3d_ros.kernels.cpu.arithmetic import EPSILON, ONE, TINY, ZERO, sincos
from srt3d_ros.kernels.cpu.compiling import parallel
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.maps import DEPTH, MARGIN


@parallel
def _unexplained(frame: Frame, state: float32[:, :, :, ::1], intensity: float32[:, :, ::1], own: float32[:, ::1],
                 taken: float32[:, ::1], background: float32[:, ::1], photons: float32[:, ::1],
                 passed: float32[:, :, ::1], out: float32[:, ::1]):
    rows, surfaces, cols = intensity.shape
    m, by_row, by_col = len(frame.energy), min(passed.shape[0] - 1, 1), min(passed.shape[1] - 1, 1)
    for i in prange(rows):
        a, energy = i + MARGIN, frame.energy
        share, inverse = np.empty(cols, np.float32), np.empty(cols, np.float32)
        cosines, sines, sums = np.empty(cols, np.float32), np.empty(cols, np.float32), out[i]
        for j in range(cols):
            inverse[j] = ONE / max(photons[i, j], EPSILON)
            share[j] = background[i, j] * inverse[j]
            sums[4 * m] += share[j] * own[i, j]
            sums[4 * m + 1] += share[j] * taken[i, j]
            sums[4 * m + 2] += share[j] * share[j] * frame.counts[a, j + MARGIN]
        for l in range(m):
            for j in range(cols):
                cosines[j], sines[j] = ZERO, ZERO
            for k in range(surfaces):
                for j in range(cols):
                    sine, cosine = sincos(frame.bin_frequencies[l] * state[a, k, DEPTH, j + MARGIN])
                    signal = intensity[i, k, j] * frame.exposure[a, j + MARGIN]
                    cosines[j] += signal * cosine
                    sines[j] += signal * sine
            left_re, left_im, seen_re, seen_im, misfit = ZERO, ZERO, ZERO, ZERO, ZERO
            for j in range(cols):
                c, d = passed[i * by_row, j * by_col, 2 * l], passed[i * by_row, j * by_col, 2 * l + 1]
                re = frame.matched[a, l, j + MARGIN] - energy[l] * cosines[j]
                im = frame.matched[a, m + l, j + MARGIN] - energy[l] * sines[j]
                left_re += share[j] * (re * c + im * d)
                left_im += share[j] * (im * c - re * d)
                seen_re += share[j] * cosines[j]
                seen_im += share[j] * sines[j]
                misfit += (re * re + im * im) * inverse[j]
            sums[l], sums[m + l], sums[2 * m + l], sums[3 * m + l] = left_re, left_im, seen_re, seen_im
            sums[4 * m + 3] += misfit / max(energy[l], TINY)


def unexplained(frame, state, intensity, own, taken, background, photons, passed):
    sums = np.zeros((len(intensity), 4 * len(frame.energy) + 4), np.float32)
    _unexplained(frame, state, intensity, own, taken, background, photons, passed.view(np.float32), sums)
    return sums.sum(axis=0, dtype=np.float64).astype(np.float32)
