"""The start of a reconstruction: which surfaces the photons show, each in the smallest window that shows it."""

import math
from dataclasses import replace
from statistics import NormalDist

import numpy as np

from srt3d_ros.core import layout
from srt3d_ros.core.frame import Frame

# σ of the pooling windows and size of their cells, pixels.
SINGLE = (0.0, 1)
SURE_SCALES = (SINGLE, (1.0, 1), (2.0, 2))
REST_SCALES = ((3.0, 2), (6.0, 4))
SURE = 7.0                      # standard deviations that leave no doubt
SMALLEST = 1e-300               # probability that floats still tell from 0
NARROWEST = 0.7                 # window of a point that its own pixel shows, pixels
FAINTEST = 0.05                 # of a pixel's first surface that a further one must give: less may be a wrong IRF's


def window_weights(sigma: float, step: int) -> np.ndarray:
    """A Gaussian over rows or columns, 1 at the centre of a cell of `step` pixels; float32 [2·radius + step]."""
    radius = math.ceil(2.5 * sigma)
    x = np.arange(2 * radius + step) - (radius + (step - 1) / 2)
    return np.exp(-x**2 / (2 * sigma**2)).astype(np.float32)


def score_threshold(false_alarm_rate: float, frame: Frame, scale=SINGLE) -> float:
    """The score at a scale with which background alone shows a point in this share of the pixels.

    A matched filter over frequencies up to k_max has about 2 k_max independent depths; each exceeds z with probability
    Q(z). One that does fills its cell, and from there spreads over the 4πσ² pixels of its window: so with cells of s²
    pixels Q(z) = P / (2 k_max) · s² / 4πσ².
    """
    sigma, step = scale
    depths = max(2 * float(frame.cycles.max()) * frame.num_bins, 1.0)
    share = step**2 / max(4 * math.pi * sigma**2, step**2)
    return -NormalDist().inv_cdf(max(false_alarm_rate / depths * share, SMALLEST))


def continuation_threshold(false_alarm_rate: float) -> float:
    """The score that is enough where the neighbours have a surface.

    The depth is known there, so nothing is searched for; and that the surface goes on is as likely beforehand as half
    the evidence: Q(z) = √P.
    """
    return -NormalDist().inv_cdf(math.sqrt(false_alarm_rate))


def find_surfaces(frame: Frame, state: np.ndarray, scales, enough: float, kernels) -> np.ndarray:
    """Matched filter on sketches pooled at growing scales; the first scale at which a pixel is sure decides.

    A scale pools the pixels that finer ones, or an earlier search, left open. At the last scale less is enough. Further
    surfaces are searched for in what those found before leave unexplained; only sure ones count.

    Args:
        frame: the frame.
        state: float32 [rows', K, FIELDS, cols'], the surfaces that are known; changed in place.
        scales: σ and cell size of each window, pixels.
        enough: the score that is enough at the last scale, standard deviations.
        kernels: the device's kernels.

    Returns:
        The state.
    """
    view = layout.crop(state, *frame.shape)                                     # [rows, K, FIELDS, cols]
    for layer in range(state.shape[1]):
        seen, open_pixels = frame, (frame.exposure > 0) & (view[:, layer, layout.INTENSITY] == 0)
        if layer > 0:
            seen = _unexplained(frame, state, layer, kernels)
            open_pixels &= view[:, layer - 1, layout.INTENSITY] > 0
        for scale in scales:
            least = enough if scale == scales[-1] and layer == 0 else max(SURE, enough)
            _search(seen, view, layer, open_pixels, scale, least, kernels)
    return state


def _unexplained(frame: Frame, state: np.ndarray, layer: int, kernels) -> Frame:
    """The frame without the surfaces that are known, each as strong as its own pixel shows it.

    With the intensity of its pool instead, too much would be taken from some pixels; then the matched filter responds
    where a surface would give the opposite, half a period away.
    """
    known = state.copy()
    known[:, :, layout.INTENSITY] = np.maximum(kernels.own_intensity(frame.padded, state), 0)
    return replace(frame, matched=layout.crop(kernels.explain(frame.padded, known)[layer], *frame.shape))


def _search(frame: Frame, view: np.ndarray, layer: int, open_pixels: np.ndarray, scale, enough: float, kernels) -> None:
    """Give the open pixels of which one scale is sure their surface, and close them."""
    rows, cols = frame.shape
    sigma, step = scale
    matched, noise, exposure = frame.matched, frame.noise, frame.exposure
    if sigma > 0:
        left = open_pixels.astype(np.float32)               # else surfaces grow over pixels that see background alone
        matched, noise, exposure = matched * left[:, None], noise * left, exposure * left
        weights = window_weights(sigma, step)
        matched = kernels.blur(matched, weights, step)
        noise = kernels.blur(noise[:, None], weights**2, step)[:, 0]
        exposure = kernels.blur(exposure[:, None], weights, step)[:, 0]
    squash = 0.5 if sigma > 0 else 1.0
    depth, intensity = (found[:, 0] for found in kernels.match(matched, frame.energy, frame.cycles, frame.num_bins, 1))
    score = significance(frame, intensity, noise, squash) / frame.noise_ratio(depth)
    found = score > enough
    row, col = np.nonzero(open_pixels & found[np.ix_(np.arange(rows) // step, np.arange(cols) // step)])
    a, b = row // step, col // step
    depth, intensity, score, noise, exposure = (values[a, b] for values in (depth, intensity, score, noise, exposure))
    points = np.zeros((len(row), layout.FIELDS), np.float32)
    points[:, layout.DEPTH] = depth % frame.num_bins
    points[:, layout.INTENSITY] = intensity / np.maximum(exposure, 1e-6)
    points[:, layout.STD] = depth_std(frame, intensity, noise, squash)
    points[:, layout.WINDOW] = max(sigma, NARROWEST)
    points[:, layout.SCORE] = score
    if layer > 0:
        new = _is_new(frame, view[row, :layer, :, col], points)
        row, col, points = row[new], col[new], points[new]
    open_pixels[row, col] = False
    view[row, layer, :, col] = points


def _is_new(frame: Frame, known: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Which points [N, FIELDS] are surfaces of their own beside the known ones [N, k, FIELDS] of their pixels."""
    apart = known[:, :, layout.DEPTH] - points[:, None, layout.DEPTH]
    apart = np.abs((apart + frame.num_bins / 2) % frame.num_bins - frame.num_bins / 2)
    resolved = (apart > 4 * frame.resolution_bins) | (known[:, :, layout.INTENSITY] == 0)
    return resolved.all(axis=1) & (points[:, layout.INTENSITY] > FAINTEST * known[:, 0, layout.INTENSITY])


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
