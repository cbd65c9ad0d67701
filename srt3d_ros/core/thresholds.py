"""Scores that are enough to show a point."""

import math
from statistics import NormalDist

from srt3d_ros.errors import require
from srt3d_ros.kernels.constants import cell_size

DEFAULT_FALSE_ALARM_RATE = 5e-5         # a pixel in 20,000: one of 141 × 141
MAX_SURFACES = 4
MAX_FALSE_ALARM_RATE = 0.4      # near 0.5 the threshold of a surface that goes on falls to -inf
SMALLEST = 1e-300               # probability that floats still tell from 0


def check_surfaces(surfaces: int) -> None:
    """Raise InvalidInput unless a method can look for so many surfaces in a pixel."""
    require(isinstance(surfaces, int) and 1 <= surfaces <= MAX_SURFACES, "surfaces", surfaces,
            f"an integer from 1 to {MAX_SURFACES}")


def score_threshold(false_alarm_rate: float, highest: int, sigma: float = 0.0) -> float:
    """Q(z) = P / (2 k_max) · s² / 4πσ²: the score with which background alone shows a point in a share P of the pixels.

    A matched filter over frequencies up to k_max has about 2 k_max independent depths; each exceeds z with probability
    Q(z). One that does fills its cell, and from there spreads over the 4πσ² pixels of its window.

    Args:
        false_alarm_rate: P.
        highest: k_max.
        sigma: σ of the window, pixels; s is the size of its cells.
    """
    cell = cell_size(sigma)**2
    share = cell / max(4 * math.pi * sigma**2, cell)
    return -NormalDist().inv_cdf(max(false_alarm_rate / (2 * highest) * share, SMALLEST))


def continuation_threshold(false_alarm_rate: float) -> float:
    """The score that is enough where the neighbours have a surface: Q(z) = √P.

    The depth is known there, so nothing is searched for; and that the surface goes on is as likely beforehand as half
    the evidence.
    """
    return -NormalDist().inv_cdf(math.sqrt(false_alarm_rate))
