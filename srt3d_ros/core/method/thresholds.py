"""Thresholds on scores, from the false alarm rate."""

import math
from statistics import NormalDist
from typing import NamedTuple, Self

from srt3d_ros.kernels.constants import START_SCORE, WHOLE_SCORE, WIDE_SCALE, cell_size

DEFAULT_FALSE_ALARM_RATE = 5e-5         # one pixel in 20,000, such as one of 141 × 141
MAX_SURFACES = 4
MAX_FALSE_ALARM_RATE = 0.4      # at 0.5, the threshold to keep an existing surface is -inf
BLOB_STARTS = 32                # pixels of a frame that may start by chance; of more, 1 frame in 60 had a blob
STAYING = 0.5                   # share of false points that survive the iterations (`benchmarks false_alarms`)


class Scores(NamedTuple):
    """Scores that decide on surfaces after the start, standard deviations.

    Args:
        find: a first surface, in the widest window.
        further: a further surface there.
        drop: points below it are removed after the first window.
        keep: a point whose depth is known, by its neighbours: Q(keep) = √(P / STAYING). No search multiplies chance,
            and the prior that a surface continues is worth half of the evidence.
        whole: the best point of a surface at the end; in its outline and depth, it has grown with chance.
    """

    find: float
    further: float
    drop: float
    keep: float
    whole: float

    @classmethod
    def of(cls, false_alarm_rate: float, highest: int, pixels: int) -> Self:
        """The scores for a share of false points, k_max and the pixels of a frame; more starts make more blobs."""
        started = false_alarm_rate / STAYING
        find = score_threshold(started, highest, WIDE_SCALE)
        start = score_threshold(min(started, BLOB_STARTS / pixels), highest, WIDE_SCALE)
        keep = -NormalDist().inv_cdf(math.sqrt(started))
        return cls(find, max(find, START_SCORE), score_threshold(started, highest), keep, start + WHOLE_SCORE)


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
    return -NormalDist().inv_cdf(false_alarm_rate / (2 * highest) * share)
