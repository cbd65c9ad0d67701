"""Log-likelihood ratio of a pixel's own photons, "surface" against "background alone", nats.

    ℓ = p ρ(v / p)² / 2 − D μ I₁ / (μ I₁ + (p − μ)₊ I₀),   D = μ − s + s ln(s / μ),   s = v / E

v ≥ 0 is the response at the surface's depth; p the photons that other surfaces leave, at least 1/2; μ is s, clipped to
within a factor LIKENESS of the expected g r, or its square where the pixel has other surfaces. Without any photons, ℓ
is at least −DEAD_LIMIT.
"""

import numpy as np
from numba import float32, prange

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, HALF, LN_2, MANTISSA, ONE, ROOT_HALF, ZERO, _LOG, polynomial
from srt3d_ros.kernels.cpu.compiling import inline, parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.maps import INTENSITY, VALUE

DEAD_LIMIT, LIKENESS = F32(constants.DEAD_LIMIT), F32(constants.LIKENESS)
SHARED_LIKENESS = LIKENESS * LIKENESS


@inline
def log(value):
    bits = F32(value).view(np.int32)
    exponent = (bits - ROOT_HALF) >> MANTISSA
    f = np.int32(bits - (exponent << MANTISSA)).view(np.float32) - ONE
    return F32(exponent) * LN_2 + f + f * f * (f * polynomial(f, _LOG) - HALF)


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


