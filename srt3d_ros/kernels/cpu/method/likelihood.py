"""Log-likelihood ratio of a pixel's own photons, "surface" against "background alone", nats.

    ℓ = p ρ(v / p)² / 2 − D μ I₁ / (μ I₁ + (p − μ)₊ I₀),   D = μ − s + s ln(s / μ),   s = v / E

v ≥ 0 is the response at the surface's depth; p the photons that other surfaces leave, at least 1/2; μ is s, clipped to
within a factor LIKENESS of the expected g r, or its square where the pixel has other surfaces. Without any photons, ℓ
is at least −DEAD_LIMIT.
"""

import numpy as np
from numba import float32, prange

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, HALF, ONE, ZERO, log
from srt3d_ros.kernels.cpu.compiling import inline, parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.maps import INTENSITY, VALUE

DEAD_LIMIT, LIKENESS = F32(constants.DEAD_LIMIT), F32(constants.LIKENESS)
SHARED_LIKENESS = LIKENESS * LIKENESS


def noise_ratio(frame, depth):
    return 1.0 if frame.clutter is None else frame.clutter[np.rint(depth).astype(np.int32) % frame.num_bins]


@inline
def noise_at(frame, depth):
    """`noise_ratio` at one depth."""
    return frame.clutter[int(np.rint(depth)) % len(frame.clutter)]


@inline
def evidence(response, photons, squares, frame):
    """The score p / √N · ρ(V₊ / p) of a response V, of p = Σ w n photons with N = Σ w² n, standard deviations."""
    table, steps, photons = frame.background_table, len(frame.background_table) - 1, max(photons, EPSILON)
    at = min(max(response / (photons * frame.max_response), ZERO), ONE) * F32(steps)
    low = min(int(at), steps - 1)
    rare = table[low] + (at - F32(low)) * (table[low + 1] - table[low])
    return photons / np.sqrt(max(squares, EPSILON)) * rare


@inline
def score_of(response, photons, frame):
    """The score of a pixel's response, as of at least half a photon."""
    photons = max(photons, HALF)
    return evidence(max(response, ZERO), photons, photons, frame)


@inline
def left(photons, explained):
    """The photons of a pixel less those that are explained, at least 1/2; 0 if the pixel has none."""
    return max(photons - explained, HALF) if photons > ZERO else ZERO


@inline
def llr(score, response, photons, expected, likeness, frame):
    """ℓ, nats. `score` is `score_of`, computed in a loop before: a lookup in a table runs in no vector register."""
    seen = max(response, ZERO) / frame.total_energy
    likely = min(max(seen, expected / likeness), expected * likeness)
    deviance = likely - seen + (seen * log(seen / likely) if seen > ZERO else ZERO)
    signal = likely * frame.intensity_moments[0]
    background = max(max(photons, HALF) - likely, ZERO) * frame.intensity_moments[1]
    ratio = HALF * score * score - deviance * signal / (signal + background)
    return max(ratio, -DEAD_LIMIT) if photons <= ZERO else ratio


@parallel
def _log_likelihood_ratio(frame: Frame, state: float32[:, :, :, ::1], terms: float32[:, :, :, ::1],
                          out: float32[:, :, ::1]):
    padded_rows, surfaces, _, padded_cols = state.shape
    for i in prange(padded_rows):
        others, photons = np.empty(padded_cols, np.float32), np.empty(padded_cols, np.float32)
        counts, exposure = frame.counts[i], frame.exposure[i]
        for k in range(surfaces):
            intensity, response, ratio = state[i, k, INTENSITY], terms[i, k, VALUE], out[i, k]
            others[:] = ZERO
            for o in range(surfaces):
                if o != k:
                    for j in range(padded_cols):
                        others[j] += state[i, o, INTENSITY, j] * exposure[j]
            for j in range(padded_cols):
                photons[j] = left(counts[j], others[j])
                ratio[j] = score_of(response[j], photons[j], frame)
            for j in range(padded_cols):
                likeness = SHARED_LIKENESS if others[j] > ZERO else LIKENESS
                there = (intensity[j] > ZERO) & (exposure[j] > ZERO)
                nats = llr(ratio[j], response[j], photons[j], intensity[j] * exposure[j], likeness, frame)
                ratio[j] = nats if there else ZERO


def log_likelihood_ratio(frame, state, terms):
    out = borrow("log_likelihood_ratio", state[:, :, 0].shape)
    _log_likelihood_ratio(frame, state, terms, out)
    return out
