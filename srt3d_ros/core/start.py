"""The start of a reconstruction: which surfaces the photons show, each in the smallest window that shows it."""

import math
from functools import lru_cache
from statistics import NormalDist

import numpy as np

from srt3d_ros.core.frame import Frame

# σ of the pooling windows and size of their cells, pixels.
SINGLE = (0.0, 1)
SURE_SCALES = (SINGLE, (1.0, 1), (2.0, 2))
REST_SCALES = ((3.0, 2), (6.0, 4))
SURE = 7.0                      # standard deviations that leave no doubt
SMALLEST = 1e-300               # probability that floats still tell from 0


@lru_cache
def window_weights(sigma: float, step: int) -> np.ndarray:
    """A Gaussian over rows or columns, 1 at the centre of a cell of `step` pixels; float32 [2·radius + step]."""
    if sigma == 0:
        return np.ones(step, np.float32)
    radius = math.ceil(2.5 * sigma)
    x = np.arange(2 * radius + step) - (radius + (step - 1) / 2)
    return np.exp(-x**2 / (2 * sigma**2)).astype(np.float32)


def score_threshold(false_alarm_rate: float, highest: int, scale=SINGLE) -> float:
    """The score at a scale with which background alone shows a point in this share of the pixels; k_max is `highest`.

    A matched filter over frequencies up to k_max has about 2 k_max independent depths; each exceeds z with probability
    Q(z). One that does fills its cell, and from there spreads over the 4πσ² pixels of its window: so with cells of s²
    pixels Q(z) = P / (2 k_max) · s² / 4πσ².
    """
    sigma, step = scale
    share = step**2 / max(4 * math.pi * sigma**2, step**2)
    return -NormalDist().inv_cdf(max(false_alarm_rate / (2 * highest) * share, SMALLEST))


def continuation_threshold(false_alarm_rate: float) -> float:
    """The score that is enough where the neighbours have a surface.

    The depth is known there, so nothing is searched for; and that the surface goes on is as likely beforehand as half
    the evidence: Q(z) = √P.
    """
    return -NormalDist().inv_cdf(math.sqrt(false_alarm_rate))


def find_surfaces(frame: Frame, state, scales, enough: float, kernels, scratch=None, carried=None,
                  confirmed: float = 0.0):
    """Matched filter on sketches pooled at growing scales; the first scale at which a pixel is sure decides.

    A scale pools the pixels that finer ones, or an earlier search, left open. At the last scale less is enough. Further
    surfaces are searched for in what those found before leave unexplained; only sure ones count.

    Args:
        frame: the frame, padded.
        state: float32 [rows', K, FIELDS, cols'], the surfaces that are known; changed in place.
        scales: σ and cell size of each window, pixels.
        enough: the score that is enough at the last scale, standard deviations.
        kernels: the device's kernels.
        scratch: memory to use.
        carried: as `state`, the last frame's surfaces; they need less evidence.
        confirmed: the score that is enough for them.

    Returns:
        The state.
    """
    for layer in range(state.shape[1]):
        matched = frame.matched if layer == 0 else kernels.leave(frame, state, layer, scratch)
        for sigma, step in scales:
            least = enough if (sigma, step) == scales[-1] and layer == 0 else max(SURE, enough)
            kernels.search(frame, matched, state, layer, sigma, window_weights(sigma, step), step, least, scratch,
                           carried, confirmed)
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
