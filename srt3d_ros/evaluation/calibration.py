"""Are depth errors as large as their reported standard deviations say?"""

from statistics import NormalDist

# Shares of errors that a normal distribution has within as many standard deviations as `deviations` gives.
NOMINAL = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.6827, 0.8, 0.9, 0.9545, 0.99)
GOALS = {0.6827: (0.60, 0.76), 0.9545: (0.90, 0.98)}        # observed shares within 1 and 2 standard deviations


def deviations(nominal) -> tuple[float, ...]:
    """How many standard deviations hold each share of normal errors: 0.6827 → 1, 0.9545 → 2."""
    return tuple(NormalDist().inv_cdf((1 + share) / 2) for share in nominal)
