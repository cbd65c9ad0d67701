"""The start of a reconstruction: which surfaces the photons show, each in the smallest window that shows it."""

import math
from statistics import NormalDist

import numpy as np

from srt3d_ros.core import layout
from srt3d_ros.core.frame import Frame

SCALES = ((0.0, 1), (1.0, 1), (2.0, 2), (4.0, 4))   # σ of the pooling window and size of its cells, pixels
SURE = 7.0                                          # standard deviations that end the search at a scale
SMALLEST = 1e-300                                   # probability that floats still tell from 0
NARROWEST = 0.7                                     # window of a point that its own pixel shows, pixels


def window_weights(sigma: float, step: int) -> np.ndarray:
    """A Gaussian over rows or columns, 1 at the centre of a cell of `step` pixels; float32 [2·radius + step]."""
    radius = math.ceil(2.5 * sigma)
    x = np.arange(2 * radius + step) - (radius + (step - 1) / 2)
    return np.exp(-x**2 / (2 * sigma**2)).astype(np.float32)


def score_threshold(false_alarm_rate: float, frame: Frame) -> float:
    """The score that background alone reaches anywhere in T with this probability, in one pixel.

    A matched filter over frequencies up to k_max has about 2 k_max independent depths; each exceeds z with probability
    Q(z), so Q(z) = P / (2 k_max).
    """
    depths = 2 * float(frame.cycles.max()) * frame.num_bins
    return -NormalDist().inv_cdf(max(false_alarm_rate / max(depths, 1.0), SMALLEST))


def find_surfaces(frame: Frame, surfaces: int, threshold: float, kernels) -> np.ndarray:
    """Matched filter on sketches pooled at growing scales; the first scale at which a pixel is sure decides.

    A scale pools the pixels that finer ones left open. At the widest scale the threshold is enough. A second surface
    must pass the threshold at the scale of the first.

    Returns:
        A state, float32 [rows', K, FIELDS, cols'].
    """
    rows, cols = frame.shape
    state = layout.no_surfaces(rows, cols, surfaces)
    view = layout.crop(state, rows, cols)
    open_pixels = frame.exposure > 0
    for sigma, step in SCALES:
        matched, noise, exposure = frame.matched, frame.noise, frame.exposure
        if sigma > 0:
            left = open_pixels.astype(np.float32)           # else surfaces grow over pixels that see background alone
            matched, noise, exposure = matched * left[:, None], noise * left, exposure * left
            weights = window_weights(sigma, step)
            matched = kernels.blur(matched, weights, step)
            noise = kernels.blur(noise[:, None], weights**2, step)[:, 0]
            exposure = kernels.blur(exposure[:, None], weights, step)[:, 0]
        squash = 0.5 if sigma > 0 else 1.0
        depth, intensity = kernels.match(matched, frame.energy, frame.cycles, frame.num_bins, surfaces)
        score = significance(frame, intensity, noise[:, None], squash)
        found = score[:, 0] > (threshold if (sigma, step) == SCALES[-1] else SURE)
        row, col = np.nonzero(open_pixels & found[np.ix_(np.arange(rows) // step, np.arange(cols) // step)])
        open_pixels[row, col] = False
        a, b = row // step, col // step
        depth, intensity, score = (values[a, :, b] for values in (depth, intensity, score))     # [N, K]
        std = depth_std(frame, intensity, noise[a, b, None], squash)
        points = np.zeros((len(row), surfaces, layout.FIELDS), np.float32)
        points[:, :, layout.DEPTH] = depth % frame.num_bins
        points[:, :, layout.INTENSITY] = intensity / np.maximum(exposure[a, b, None], 1e-6)
        points[:, :, layout.STD] = std
        points[:, :, layout.WINDOW] = max(sigma, NARROWEST)
        points[:, :, layout.SCORE] = score
        points[score <= threshold] = 0
        view[row, :, :, col] = points
    return state


def significance(frame: Frame, signal: np.ndarray, noise: np.ndarray, squash: float) -> np.ndarray:
    """Evidence of matched filters against "background alone", standard deviations; also right for few photons.

    Args:
        signal: Σ w r.
        noise: Σ w² n.
        squash: Σ w² / Σ w of the window: 1 for a single pixel, 1/2 for a Gaussian.
    """
    photons = np.maximum(noise / squash, 1e-6)                                                  # Σ w n
    steps = len(frame.rarity) - 1
    at = np.clip(signal / photons * (frame.total_energy / frame.greatest_response * steps), 0, steps)
    low = np.minimum(at.astype(np.int32), steps - 1)        # np.interp does the same, in ten times the time
    worth = frame.rarity[low] + (at - low) * np.diff(frame.rarity)[low]
    return np.sqrt(photons / squash) * worth


def depth_std(frame: Frame, signal: np.ndarray, noise: np.ndarray, squash: float) -> np.ndarray:
    """Standard deviation of depths found in windows, bins.

    Args: as of `significance`.
    """
    signal = np.maximum(signal, 1e-6)
    background = np.maximum(noise / squash - signal, 0)
    spread = squash * (signal * frame.moments[0] + background * frame.moments[1])
    return np.minimum(np.sqrt(spread) / (signal * frame.curvature), frame.num_bins)
