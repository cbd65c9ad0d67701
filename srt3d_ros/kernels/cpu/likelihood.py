"""How much more likely a pixel's own photons are with a surface than without."""

import numpy as np
from numba import prange

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, HALF, ONE, ZERO, log
from srt3d_ros.kernels.cpu.compiling import inline, parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.maps import INTENSITY, VALUE

BIRTH, LIKENESS = F32(constants.BIRTH), F32(constants.LIKENESS)
SHARED_LIKENESS = LIKENESS * LIKENESS


@inline
def surprise(mean_response, background_table):
    """ρ(u), linear between the entries of the table; u as a share of a photon's greatest response, held to [0, 1]."""
    steps = len(background_table) - 1
    at = min(max(mean_response, ZERO), ONE) * F32(steps)
    low = min(int(at), steps - 1)
    return background_table[low] + (at - F32(low)) * (background_table[low + 1] - background_table[low])


@inline
def evidence(response, photons, squares, max_response, background_table):
    """The score of a response Σ w R of photons, Σ w n and Σ w² n: against "background alone", standard deviations."""
    photons = max(photons, EPSILON)
    mean = response / (photons * max_response)
    return photons / np.sqrt(max(squares, EPSILON)) * surprise(mean, background_table)


@inline
def left(photons, explained):
    """The photons of a pixel without those that are explained, at least 1/2; 0 if it has seen none at all."""
    return max(photons - explained, HALF) if photons > ZERO else ZERO


@inline
def llr(score, response, photons, expected, likeness, total, moments):
    """Log-likelihood ratio of "a surface of about this intensity and background" and "background alone", nats.

    Args:
        score: the evidence of the response, in a pass of its own: no vector register looks up a table.
        response: of the pixel's photons to the matched filter at the surface's depth.
        photons: of the pixel, those of its other surfaces left out; 0 if it has seen none at all.
        expected: signal photons that the surface should give, to within the factor `likeness`.
    """
    seen = max(response, ZERO) / total
    likely = min(max(seen, expected / likeness), expected * likeness)
    deviance = likely - seen + (seen * log(seen / likely) if seen > ZERO else ZERO)
    signal, background = likely * moments[0], max(max(photons, HALF) - likely, ZERO) * moments[1]
    ratio = HALF * score * score - deviance * signal / (signal + background)
    return max(ratio, -BIRTH) if photons <= ZERO else ratio


@inline
def score_of(response, photons, max_response, background_table):
    """The evidence of a pixel's photons, at least half of one."""
    photons = max(photons, HALF)
    return evidence(max(response, ZERO), photons, photons, max_response, background_table)


@parallel
def _log_likelihood_ratio(counts, exposure, total, max_response, background_table, moments, state, terms, out):
    padded_rows, surfaces, _, padded_cols = state.shape
    for i in prange(padded_rows):
        others, photons = np.empty(padded_cols, np.float32), np.empty(padded_cols, np.float32)
        for k in range(surfaces):
            intensity, response, ratio = state[i, k, INTENSITY], terms[i, k, VALUE], out[i, k]
            others[:] = ZERO
            for o in range(surfaces):
                if o != k:
                    for j in range(padded_cols):
                        others[j] += state[i, o, INTENSITY, j] * exposure[i, j]
            for j in range(padded_cols):
                photons[j] = left(counts[i, j], others[j])
                ratio[j] = score_of(response[j], photons[j], max_response, background_table)
            for j in range(padded_cols):
                likeness = SHARED_LIKENESS if others[j] > ZERO else LIKENESS
                there = (intensity[j] > ZERO) & (exposure[i, j] > ZERO)
                nats = llr(ratio[j], response[j], photons[j], intensity[j] * exposure[i, j], likeness, total, moments)
                ratio[j] = nats if there else ZERO


def log_likelihood_ratio(frame, state, terms):
    out = borrow("log_likelihood_ratio", state[:, :, 0].shape)
    _log_likelihood_ratio(frame.counts, frame.exposure, F32(frame.total_energy), F32(frame.max_response),
                          frame.background_table, frame.intensity_moments, state, terms, out)
    return out
