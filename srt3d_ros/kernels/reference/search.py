"""One scale of the start: `search` and `drop_weak` of `kernels.api`."""

import numpy as np

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import APART, FAINTEST, STAY
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, MARGIN, SCORE, SLOPE_COL, SLOPE_ROW, STD, window_weights
from srt3d_ros.kernels.reference.arithmetic import EPSILON, noise_ratio, pixel_z, response_of, wrap
from srt3d_ros.kernels.reference.likelihood import surprise
from srt3d_ros.kernels.reference.prepare import blur, match

FOUND = [DEPTH, SLOPE_COL, SLOPE_ROW, INTENSITY, STD, SCORE]        # fields that a search fills in


def search(frame, matched, state, layer, sigma, step, enough, scratch=None, carried=None, confirmed=0.0):
    size = frame.shape
    view, exposure = maps.crop(state, *size), maps.crop(frame.exposure, *size)
    is_open = (exposure > 0) & (view[:, layer, INTENSITY] == 0)
    if layer > 0:
        is_open &= view[:, layer - 1, INTENSITY] > 0
    pools = maps.crop(matched, *size), maps.crop(frame.counts, *size)[:, None], exposure[:, None]
    share = 1.0
    if sigma > 0:
        weights, share = window_weights(sigma / step), 0.5
        pools = [blur(values * is_open[:, None], w, step) for values, w in zip(pools, (weights, weights**2, weights))]
    pooled, counts, light = pools[0], pools[1][:, 0].astype(float), np.maximum(pools[2][:, 0], EPSILON)
    depth, signal = (found[:, 0] for found in match(pooled, frame.energy, frame.bin_frequencies, frame.num_bins, 1))
    for i, j in np.argwhere(is_open):
        cell = i // step, j // step

        def measured(t, slopes, signal):
            """The fields FOUND of a surface at depth t with this signal in the pixel's cell."""
            score = _score(frame, signal, counts[cell], share) / noise_ratio(frame, t)
            return np.array([t, *slopes, signal / light[cell], _std(frame, signal, counts[cell], share), score])

        point = measured(depth[cell] % frame.num_bins, (0, 0), signal[cell])
        if carried is not None and carried[MARGIN + i, layer, INTENSITY, MARGIN + j] > 0:
            t, *slopes = carried[MARGIN + i, layer, FOUND[:3], MARGIN + j].astype(float)
            old = measured(t, slopes, response_of(pixel_z(pooled, *cell), t, frame) / frame.total_energy)
            if old[-1] > confirmed and point[-1]**2 - old[-1]**2 < 2 * STAY:
                view[i, layer, FOUND, j] = old
                continue
        known = view[i, :layer, :, j]
        if point[-1] > enough and (layer == 0 or _is_new(frame, known, point[0], signal[cell] / light[cell])):
            view[i, layer, FOUND, j] = point


def _score(frame, signal, counts, share) -> float:
    photons = max(counts / share, EPSILON)
    return np.sqrt(photons / share) * surprise(signal * frame.total_energy, photons, frame)


def _std(frame, signal, counts, share) -> float:
    signal = max(signal, EPSILON)
    background = max(counts / share - signal, 0)
    spread = share * (signal * frame.moments[0] + background * frame.moments[1])
    return min(np.sqrt(spread) / (signal * frame.curvature), frame.num_bins)


def _is_new(frame, known, depth, intensity) -> bool:
    """Whether a point is a surface beside the known ones [k, FIELDS] of its pixel: resolved, not too faint."""
    apart = np.abs(wrap(known[:, DEPTH] - depth, frame.num_bins)) > APART * frame.resolution_bins
    return bool((apart | (known[:, INTENSITY] == 0)).all() and intensity > FAINTEST * known[0, INTENSITY])


def drop_weak(state, weak):
    state[:, :, INTENSITY][state[:, :, SCORE] < weak] = 0
