"""Of `kernels.api`: `pixelwise` and `poisson`."""

import numpy as np

from srt3d_ros.kernels.constants import INTENSITY_RATE
from srt3d_ros.kernels.reference.arithmetic import angular, expected, pixel_z


def pixelwise(frame, table, rate, usual, depth, intensity):
    omega, levels = angular(frame), len(table)
    before_depth, before_intensity = depth.astype(float), intensity.astype(float)
    for i, k, j in np.argwhere(before_intensity > 0):
        g = float(frame.exposure[i, j])
        points = zip(before_depth[i, :, j], before_intensity[i, :, j])
        rest = pixel_z(frame.matched, i, j) - sum(expected(g * r, t, frame) for t, r in points)
        t, r = before_depth[i, k, j], before_intensity[i, k, j]
        d = rest * np.exp(-1j * omega * t)
        share = min(g * r / max(frame.counts[i, j], 1), 1)
        weights = table[int(share * (levels - 1) + 0.5)].astype(float)
        shift = weights[0] @ d.real + weights[1] @ d.imag
        change = weights[2] @ d.real + weights[3] @ d.imag
        grown = r + INTENSITY_RATE * change / g
        signal = g * max(r, grown)
        step = rate * shift * signal / max(signal, usual * g)**2
        depth[i, k, j] = (t + np.clip(step, -frame.resolution_bins, frame.resolution_bins)) % frame.num_bins
        intensity[i, k, j] = max(grown, 0)


def poisson(frame, background, rate, usual, depth, intensity):
    stray = np.zeros(background.shape)
    surfaces, cols = depth.shape[1:]
    for i, j in np.argwhere(frame.exposure > 0):
        p, g = i * cols + j, float(frame.exposure[i, j])
        own = p if len(frame.irf) > 1 else 0
        t, r = depth[i, :, j].astype(float), intensity[i, :, j].astype(float)
        signal, score = np.zeros(surfaces), np.zeros(surfaces)
        for x in frame.toa[frame.starts[p]:frame.starts[p + 1]].astype(float):
            lit = np.array([irf_at(x - t[k] + frame.ref, frame.irf[own], frame.slope[own], frame.num_bins)
                            if r[k] > 0 else (0, 0) for k in range(surfaces)])
            total = background[i, j] + r @ lit[:, 0]
            stray[i, j] += background[i, j] / total
            signal += r * lit[:, 0] / total
            score -= r * lit[:, 1] / total
        for k in np.flatnonzero(r > 0):
            reach = 1 / np.sqrt(frame.information)
            step = rate * score[k] / (max(signal[k], usual * g) * frame.information)
            depth[i, k, j] = (t[k] + np.clip(step, -reach, reach)) % frame.num_bins
            change = INTENSITY_RATE * (signal[k] - g * r[k]) / max(g * r[k], usual * g)
            intensity[i, k, j] = r[k] * np.exp(min(change, 1))
    return stray


def irf_at(place, irf, slope, num_bins):
    """h and h′ between entries, which lie on a circle of T bins."""
    entries = np.zeros((2, num_bins))
    entries[:, :len(irf)] = irf, slope
    low = int(np.floor(place))
    part = place - low
    return (1 - part) * entries[:, low % num_bins] + part * entries[:, (low + 1) % num_bins]
