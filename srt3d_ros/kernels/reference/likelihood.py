"""How much a pixel's own photons speak for its surfaces: `log_likelihood_ratio` of `kernels.api`."""

import numpy as np

from srt3d_ros.kernels.constants import DEAD_PIXEL, LIKENESS
from srt3d_ros.kernels.maps import INTENSITY, VALUE


def surprise(response, photons, frame) -> float:
    """ρ(response / photons): what it is worth as evidence against "background alone", per √photon."""
    means = np.linspace(0, frame.max_response, len(frame.background_table))
    return np.interp(response / photons, means, frame.background_table.astype(float))


def llr(response, photons, expected, likeness, frame) -> float:
    """Log-likelihood ratio of a surface of about `expected` photons and of "background alone", nats."""
    value, n = max(response, 0.0), max(photons, 0.5)
    improbable_for_background = n * surprise(value, n, frame)**2 / 2

    seen = value / frame.total_energy
    likely = np.clip(seen, expected / likeness, expected * likeness)
    deviance = likely - seen + (seen * np.log(seen / likely) if seen > 0 else 0)
    by_signal, by_background = likely * frame.intensity_moments[0], max(n - likely, 0) * frame.intensity_moments[1]
    improbable_for_surface = deviance * by_signal / (by_signal + by_background)

    ratio = improbable_for_background - improbable_for_surface
    return max(ratio, DEAD_PIXEL) if photons <= 0 else ratio


def left(photons, explained) -> float:
    """The photons of a pixel without those that are explained, at least 1/2; 0 if it has seen none at all."""
    return max(photons - explained, 0.5) if photons > 0 else 0.0


def log_likelihood_ratio(frame, state, terms, scratch=None):
    state = state.astype(np.float64)
    own = np.zeros((state.shape[0], state.shape[1], state.shape[3]))
    for i, k, j in np.argwhere((state[:, :, INTENSITY] > 0) & (frame.exposure[:, None] > 0)):
        gives = state[i, :, INTENSITY, j] * frame.exposure[i, j]
        others = gives.sum() - gives[k]
        likeness = LIKENESS**2 if others > 0 else LIKENESS
        photons = left(frame.counts[i, j], others)
        own[i, k, j] = llr(terms[i, k, VALUE, j], photons, gives[k], likeness, frame)
    return own
