"""Thresholds on scores, from the false alarm rate."""

import math
from statistics import NormalDist

from srt3d_ros.errors import require
from srt3d_ros.kernels.constants import cell_size

DEFAULT_FALSE_ALARM_RATE = 5e-5         # one pixel in 20,000, such as one of 141 × 141
MAX_SURFACES = 4
MAX_FALSE_ALARM_RATE = 0.4      # near 0.5 the threshold of a surface that goes on falls to -inf
SMALLEST = 1e-300               # least probability: keeps the threshold finite


def check_surfaces(surfaces: int) -> None:
    """Raise InvalidInput unless `surfaces` is a possible number of surfaces in a pixel."""
    require(isinstance(surfaces, int) and 1 <= surfaces <= MAX_SURFACES, "surfaces", surfaces,
            f"an integer from 1 to {MAX_SURFACES}")


def score_threshold(false_alarm_rate: float, highest: int, sigma: float = 0.0) -> float:
    """The score z that background alone reaches in a share P of the pixels: Q(z) = P / (2 k_max) · s² / 4πσ².

    A matched filter over frequencies up to k_max has about 2 k_max independent depths, each of which exceeds z with
    probability Q(z). A false point fills its cell and spreads over the 4πσ² pixels of its window.

    Args:
        false_alarm_rate: P.
        highest: k_max.
        sigma: σ of the window, pixels; s is the side of its cells.
    """
    cell = cell_size(sigma)**2
    share = cell / max(4 * math.pi * sigma**2, cell)
    return -NormalDist().inv_cdf(max(false_alarm_rate / (2 * highest) * share, SMALLEST))


def continuation_threshold(false_alarm_rate: float) -> float:
    """The score z that suffices next to pixels with a surface: Q(z) = √P.

    The depth is known there, so no search multiplies chance; and the prior that a surface continues is worth half of
    the evidence.
    """
    return -NormalDist().inv_cdf(math.sqrt(false_alarm_rate))
