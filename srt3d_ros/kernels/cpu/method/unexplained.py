"""Sums over the pixels of what the points do not explain, from which the background is estimated.

With y_l = g Σ_k r_k exp(i ω_l t_k) and w = b̄ / n̄: of w conj(q_l) (z_l − |ĥ_l|² y_l), of w y_l (real parts before
imaginary ones), of w · own, w · taken, w² n and Σ_l |z_l − |ĥ_l|² y_l|² / |ĥ_l|² n̄. Own are the photons of `rest` in
used pixels, b̄ and n̄ local means of own and of n. Rows are summed in float32, their sums in float64.
"""

import numpy as np
from numba import get_thread_id, prange

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import LOCAL_SIGMA
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, ONE, TINY, ZERO, sincos
from srt3d_ros.kernels.cpu.compiling import floats1d, floats2d, floats3d, floats4d, line, parallel
from srt3d_ros.kernels.cpu.method.frame import Frame, columns, point_at
from srt3d_ros.kernels.cpu.method.windows import blur_row
from srt3d_ros.kernels.cpu.vectors import fma, full, lane_numbers, lanes_of, load, store, total, where
from srt3d_ros.kernels.maps import MARGIN

OWN, PHOTONS, USED = range(3)       # of `seen`: own, n, 1 in used pixels


@line
def _see_row(i, frame, rest, seen):
    """Write what is averaged around pixels."""
    for j in columns(rest):
        used = where(load(frame.exposure, i, j) > ZERO, ONE, ZERO)
        store(seen, i, OWN, j, load(rest, i, j) * used)
        store(seen, i, PHOTONS, j, load(frame.counts, i, j))
        store(seen, i, USED, j, used + EPSILON)


@line
def _shown_at(i, j, l, frame, points):
    """Re y_l and Im y_l."""
    re = im = full(ZERO)
    for k in range(points.shape[1]):
        point = point_at(points, i, k, j)
        signal = point.intensity * load(frame.exposure, i, j)
        if lanes_of(signal > ZERO):
            sine, cosine = sincos(frame.bin_frequencies[l] * point.depth)
            re, im = fma(signal, cosine, re), fma(signal, sine, im)
    return re, im


@line
def _sum_row(i, frame, points, seen, taken, passed, means, sums):
    m, last = len(frame.energy), passed.shape[1] - 1
    own = given = counts = misfit = full(ZERO)
    for j in columns(points):
        used = load(frame.exposure, i, j) > ZERO
        around = max(where(used, load(means, PHOTONS, j) / load(means, USED, j), ZERO), EPSILON)
        w = where(used, load(means, OWN, j) / load(means, USED, j), ZERO) / around
        own, given = fma(w, load(seen, i, OWN, j), own), fma(w, load(taken, i, j), given)
        counts = fma(w * w, load(frame.counts, i, j), counts)
        store(means, OWN, j, w)
        store(means, PHOTONS, j, ONE / around)
    for l in range(m):
        energy, left_re, left_im, shown_re, shown_im = frame.energy[l], full(ZERO), full(ZERO), full(ZERO), full(ZERO)
        for j in columns(points):
            w, inverse = load(means, OWN, j), load(means, PHOTONS, j)
            y_re, y_im = _shown_at(i, j, l, frame, points)
            re, im = load(frame.matched, i, l, j) - energy * y_re, load(frame.matched, i, m + l, j) - energy * y_im
            row, cols = min(i - MARGIN, len(passed) - 1), min(lane_numbers() + (j - MARGIN), last)
            q_re, q_im = full(passed[row, 0, 2 * l]), full(passed[row, 0, 2 * l + 1])
            if last > 0:
                q_re, q_im = load(passed, row, cols, 2 * l), load(passed, row, cols, 2 * l + 1)
            left_re, left_im = left_re + w * (re * q_re + im * q_im), left_im + w * (im * q_re - re * q_im)
            shown_re, shown_im = fma(w, y_re, shown_re), fma(w, y_im, shown_im)
            misfit += (re * re + im * im) * inverse / max(energy, TINY)
        sums[l], sums[m + l], sums[2 * m + l], sums[3 * m + l] = (
            total(left_re), total(left_im), total(shown_re), total(shown_im))
    sums[4 * m], sums[4 * m + 1], sums[4 * m + 2], sums[4 * m + 3] = (
        total(own), total(given), total(counts), total(misfit))


@parallel
def _unexplained(frame: Frame, points: floats4d, rest: floats2d, taken: floats2d, passed: floats3d, weights: floats1d,
                 seen: floats3d, means: floats3d, out: floats2d):
    for i in prange(MARGIN, len(rest) - MARGIN):
        _see_row(i, frame, rest, seen)
    for i in prange(MARGIN, len(rest) - MARGIN):
        own = means[get_thread_id()]
        blur_row(seen, i, weights, own[-1], own[-2], own)
        _sum_row(i, frame, points, seen, taken, passed, own, out[i - MARGIN])


def unexplained(work, frame, points, rest, taken, passed):
    shape = frame.shape
    maps.crop(work.rest, *shape)[:] = rest
    maps.crop(work.taken, *shape)[:] = rest if taken is None else taken
    sums = np.empty((shape[0], 4 * len(frame.energy) + 4), np.float32)
    _unexplained(frame, points, work.rest, work.taken, passed.view(np.float32), maps.window_weights(LOCAL_SIGMA),
                 work.seen, work.means, sums)
    return sums.sum(axis=0, dtype=np.float64).astype(np.float32)
