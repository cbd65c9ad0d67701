"""Sums over the pixels of what the points do not explain, from which the background is estimated.

With y_l = g Σ_k r_k exp(i ω_l t_k) and w = b̄ / n̄: of w conj(q_l) (z_l − |ĥ_l|² y_l), of w y_l (real parts before
imaginary ones), of w · own, w · taken, w² n and Σ_l |z_l − |ĥ_l|² y_l|² / |ĥ_l|² n̄. Rows are summed in float32, their
sums in float64.
"""

import numpy as np
from numba import float32, prange

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, ONE, TINY, ZERO, sincos
from srt3d_ros.kernels.cpu.compiling import line, parallel
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.cpu.vectors import fma, full, gather, lane_numbers, lanes_of, load, total
from srt3d_ros.kernels.maps import DEPTH, LANES, MARGIN

OWN, TAKEN, BACKGROUND, PHOTONS, SURFACES = range(5)        # rows of `seen`: own, taken, b̄, n̄, and r of each surface


@line
def _passed_at(passed, i, j, c):
    """Part c of q in the pixels (i, j …), of a map or of one number for all rows or columns."""
    at = min(lane_numbers() + j, passed.shape[1] - 1)
    return gather(passed, i, at, c) if passed.shape[1] > 1 else full(passed[i, 0, c])


@line
def _shown_at(i, j, l, frame, state, seen):
    """Re y_l and Im y_l."""
    re = im = full(ZERO)
    for k in range(state.shape[1]):
        signal = load(seen, i, SURFACES + k, j) * load(frame.exposure, i, j)
        if lanes_of(signal > ZERO):
            sine, cosine = sincos(frame.bin_frequencies[l] * load(state, i, k, DEPTH, j))
            re, im = fma(signal, cosine, re), fma(signal, sine, im)
    return re, im


@line
def _sum_row(i, frame, state, seen, passed, sums):
    m, ends = len(frame.energy), state.shape[3] - MARGIN
    own = taken = counts = misfit = full(ZERO)
    for j in range(MARGIN, ends, LANES):
        w = load(seen, i, BACKGROUND, j) / max(load(seen, i, PHOTONS, j), EPSILON)
        own, taken = fma(w, load(seen, i, OWN, j), own), fma(w, load(seen, i, TAKEN, j), taken)
        counts = fma(w * w, load(frame.counts, i, j), counts)
    for l in range(m):
        energy, left_re, left_im, shown_re, shown_im = frame.energy[l], full(ZERO), full(ZERO), full(ZERO), full(ZERO)
        for j in range(MARGIN, ends, LANES):
            inverse = ONE / max(load(seen, i, PHOTONS, j), EPSILON)
            w = load(seen, i, BACKGROUND, j) * inverse
            y_re, y_im = _shown_at(i, j, l, frame, state, seen)
            re, im = load(frame.matched, i, l, j) - energy * y_re, load(frame.matched, i, m + l, j) - energy * y_im
            row, col = min(i - MARGIN, len(passed) - 1), j - MARGIN
            q_re, q_im = _passed_at(passed, row, col, 2 * l), _passed_at(passed, row, col, 2 * l + 1)
            left_re, left_im = left_re + w * (re * q_re + im * q_im), left_im + w * (im * q_re - re * q_im)
            shown_re, shown_im = fma(w, y_re, shown_re), fma(w, y_im, shown_im)
            misfit += (re * re + im * im) * inverse / max(energy, TINY)
        sums[l], sums[m + l], sums[2 * m + l], sums[3 * m + l] = (
            total(left_re), total(left_im), total(shown_re), total(shown_im))
    sums[4 * m], sums[4 * m + 1], sums[4 * m + 2], sums[4 * m + 3] = (
        total(own), total(taken), total(counts), total(misfit))


@parallel
def _unexplained(frame: Frame, state: float32[:, :, :, ::1], seen: float32[:, :, ::1], passed: float32[:, :, ::1],
                 out: float32[:, ::1]):
    for turn in prange(len(out)):
        _sum_row(turn + MARGIN, frame, state, seen, passed, out[turn])


def unexplained(work, frame, state, intensity, own, taken, background, photons, passed):
    inner = maps.crop(work.seen, *frame.shape)
    for at, values in ((OWN, own), (TAKEN, taken), (BACKGROUND, background), (PHOTONS, photons)):
        inner[:, at] = values
    inner[:, SURFACES:] = intensity
    sums = np.empty((len(intensity), 4 * len(frame.energy) + 4), np.float32)
    _unexplained(frame, state, work.seen, passed.view(np.float32), sums)
    return sums.sum(axis=0, dtype=np.float64).astype(np.float32)
