"""DeadTime: the bins for which a photon blinds its pixel, if that lasts a laser period or longer."""

from typing import NamedTuple

import numpy as np


class DeadTime(NamedTuple):
    """q laser periods P and d more bins, on an axis of T bins: T = P, or those of a gate. q = 0: less than a period.

    A photon at bin x blinds its pixel q times for each bin, and once more for the d bins after x, which wrap around P.
    """

    periods: int        # q
    rest: float         # d, bins
    period: float       # P, bins
    num_bins: int       # T

    @property
    def cycles(self) -> float:
        """Laser cycles that a photon costs; 0 if the dead time is less than a period."""
        return self.periods + self.rest / self.period

    def blinded(self, x: np.ndarray) -> np.ndarray:
        """How often a photon at x, in [0, P), blinds its pixel for a bin of the axis, on average."""
        after = np.clip(np.minimum(self.num_bins - x, self.rest), 0, None)
        wrapped = np.clip(x + self.rest - self.period, 0, self.num_bins)
        return self.periods + (after + wrapped) / self.num_bins
