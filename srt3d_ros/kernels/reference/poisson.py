"""Gradient steps of every point on its own pixel's photons: `poisson` of `kernels.api`."""

import numpy as np

from srt3d_ros.kernels.constants import INTENSITY_RATE


def poisson(frame, background, rate, usual, depth, intensity):
    """Loop over pixels and their photons."""
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
