"""Scores that are enough to show a point, and the score of a matched filter's response."""

import math
from statistics import NormalDist

import numpy as np

from srt3d_ros.core.matched_frame import MatchedFrame

SMALLEST = 1e-300               # probability that floats still tell from 0


def score_threshold(false_alarm_rate: float, highest: int, scale: tuple[float, int] = (0.0, 1)) -> float:
    """Q(z) = P / (2 k_max) · s² / 4πσ²: the score with which background alone shows a point in a share P of the pixels.

    A matched filter over frequencies up to k_max has about 2 k_max independent depths; each exceeds z with probability
    Q(z). One that does fills its cell, and from there spreads over the 4πσ² pixels of its window.

    Args:
        false_alarm_rate: P.
        highest: k_max.
        scale: σ of the window and size s of its cells, pixels.
    """
    sigma, step = scale
    share = step**2 / max(4 * math.pi * sigma**2, step**2)
    return -NormalDist().inv_cdf(max(false_alarm_rate / (2 * highest) * share, SMALLEST))


def continuation_threshold(false_alarm_rate: float) -> float:
    """The score that is enough where the neighbours have a surface: Q(z) = √P.

    The depth is known there, so nothing is searched for; and that the surface goes on is as likely beforehand as half
    the evidence.
    """
    return -NormalDist().inv_cdf(math.sqrt(false_alarm_rate))


def score(frame: MatchedFrame, signal: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Score of single pixels' matched filters against "background alone", standard deviations; right for few photons.

    `signal` is the filter's response over Σ|ĥ_l|², photons, float [rows, K, cols], `counts` are all photons.
    """
    photons = np.maximum(counts, 1e-6)
    responses = np.linspace(0, frame.max_response, len(frame.background_table))
    return np.sqrt(photons) * np.interp(signal / photons * frame.total_energy, responses, frame.background_table)
