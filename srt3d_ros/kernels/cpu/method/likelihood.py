"""Log-likelihood ratio of a pixel's own photons, "surface" against "background alone", nats.

    ℓ = p ρ(v / p)² / 2 − D μ I₁ / (μ I₁ + (p − μ)₊ I₀),   D = μ − s + s ln(s / μ),   s = v / E

v ≥ 0 is the response at the surface's depth; p the photons that other surfaces leave, at least 1/2; μ is s, clipped to
within a factor LIKENESS of the expected g r, or its square where the pixel has other surfaces. Without any photons, ℓ
is at least −DEAD_LIMIT.
"""

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, HALF, ONE, ZERO, log
from srt3d_ros.kernels.cpu.compiling import each_row, floats3d, floats4d, inline
from srt3d_ros.kernels.cpu.method.frame import Frame, columns
from srt3d_ros.kernels.cpu.vectors import floor, full, load, rint, sqrt, store, to_cell, to_floats, where
from srt3d_ros.kernels.maps import INTENSITY, VALUE

DEAD_LIMIT, LIKENESS = F32(constants.DEAD_LIMIT), F32(constants.LIKENESS)
SHARED_LIKENESS = LIKENESS * LIKENESS


@inline
def by_bin(table, depth):
    """The entries [T] of a table at the bins nearest to depths, or to distances, around the circle."""
    bins, bin = F32(len(table)), rint(depth)
    return load(table, to_cell(bin - bins * floor(bin / bins), bins - ONE))


@inline
def noise_at(frame, depth):
    """c(t), `clutter` at the nearest bin."""
    return by_bin(frame.clutter, depth)


@inline
def evidence(response, photons, squares, frame):
    """The score p / √N · ρ(V₊ / p) of a response V, of p = Σ w n photons with N = Σ w² n, standard deviations."""
    table, last, photons = frame.background_table, F32(len(frame.background_table) - 1), max(photons, EPSILON)
    at = min(max(response / (photons * frame.max_response), ZERO), ONE) * last
    low = to_cell(at, last - ONE)
    before, after = load(table, low), load(table, low + 1)
    return photons / sqrt(max(squares, EPSILON)) * (before + (at - to_floats(low)) * (after - before))


@inline
def score_of(response, photons, frame):
    """The score of a pixel's response, as of at least half a photon."""
    photons = max(photons, HALF)
    return evidence(max(response, ZERO), photons, photons, frame)


@inline
def left(photons, explained):
    """The photons of a pixel less those that are explained, at least 1/2; 0 if the pixel has none."""
    return where(photons > ZERO, max(photons - explained, HALF), ZERO)


@inline
def llr(response, photons, expected, likeness, frame):
    """ℓ of a response of so many photons, nats, where a surface should give the `expected` ones."""
    score, seen = score_of(response, photons, frame), max(response, ZERO) / frame.total_energy
    likely = min(max(seen, expected / likeness), expected * likeness)
    deviance = likely - seen + where(seen > ZERO, seen * log(seen / likely), ZERO)
    signal = likely * frame.intensity_moments[0]
    background = max(max(photons, HALF) - likely, ZERO) * frame.intensity_moments[1]
    ratio = HALF * score * score - deviance * signal / (signal + background)
    return where(photons > ZERO, ratio, max(ratio, -DEAD_LIMIT))


@each_row
def _log_likelihood_ratio(i, frame: Frame, state: floats4d, terms: floats4d, out: floats3d):
    surfaces = state.shape[1]
    for j in columns(state):
        counts, exposure, given = load(frame.counts, i, j), load(frame.exposure, i, j), full(ZERO)
        for k in range(surfaces):
            given += load(state, i, k, INTENSITY, j) * exposure
        for k in range(surfaces):
            expected = load(state, i, k, INTENSITY, j) * exposure
            others = given - expected if surfaces > 1 else full(ZERO)
            likeness = where(others > ZERO, SHARED_LIKENESS, LIKENESS)
            ratio = llr(load(terms, i, k, VALUE, j), left(counts, others), expected, likeness, frame)
            store(out, i, k, j, where(expected > ZERO, ratio, ZERO))


def log_likelihood_ratio(work, frame, state, terms):
    _log_likelihood_ratio(frame, state, terms, work.ratios)
    return work.ratios
