"""Log-likelihood ratio of a pixel's own photons, "surface" against "background alone", nats.

    ℓ = p ρ(v / p)² / 2 − D μ I₁ / (μ I₁ + (p − μ)₊ I₀),   D = μ − s + s ln(s / μ),   s = v / E

v ≥ 0 is the response at the surface's depth; p the photons that other surfaces leave, at least 1/2; μ is s, clipped to
within a factor LIKENESS of the expected g r, or its square where the pixel has other surfaces. Without any photons, ℓ
is at least −DEAD_LIMIT.
"""

from srt3d_ros.kernels.constants import DEAD_LIMIT, EPSILON, LIKENESS
from srt3d_ros.kernels.cpu.arithmetic import F32, log
from srt3d_ros.kernels.cpu.compiling import each, floats3d, floats4d, inline
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.cpu.vectors import floor, full, rint, sqrt, to_floats, to_ints, where
from srt3d_ros.kernels.maps import INTENSITY, VALUE

SHARED_LIKENESS = LIKENESS**2


@inline
def by_bin(table, depth):
    """The entries [T] of a table at the bins nearest to depths, or to distances, around the circle."""
    bins, bin = F32(len(table)), rint(depth)
    return table[to_ints(bin - bins * floor(bin / bins), bins - 1)]


@inline
def noise_at(frame, depth):
    """c(t), `clutter` at the nearest bin."""
    return by_bin(frame.clutter, depth)


@inline
def evidence(response, photons, squares, frame):
    """The score p / √N · ρ(V₊ / p) of a response V, of p = Σ w n photons with N = Σ w² n, standard deviations."""
    table, last, photons = frame.background_table, F32(len(frame.background_table) - 1), max(photons, EPSILON)
    at = min(max(response / (photons * frame.max_response), 0), 1) * last
    low = to_ints(at, last - 1)
    before, after = table[low], table[low + 1]
    return photons / sqrt(max(squares, EPSILON)) * (before + (at - to_floats(low)) * (after - before))


@inline
def score_of(response, photons, frame):
    """The score of a pixel's response, as of at least half a photon."""
    photons = max(photons, 0.5)
    return evidence(max(response, 0), photons, photons, frame)


@inline
def left(photons, explained):
    """The photons of a pixel less those that are explained, at least 1/2; 0 if the pixel has none."""
    return where(photons > 0, max(photons - explained, 0.5), 0)


@inline
def llr(response, photons, expected, likeness, frame):
    """ℓ of a response of so many photons, nats, where a surface should give the `expected` ones."""
    score, seen = score_of(response, photons, frame), max(response, 0) / frame.total_energy
    likely = min(max(seen, expected / likeness), expected * likeness)
    deviance = likely - seen + where(seen > 0, seen * log(seen / likely), 0)
    signal = likely * frame.intensity_moments[0]
    background = max(max(photons, 0.5) - likely, 0) * frame.intensity_moments[1]
    ratio = 0.5 * score * score - deviance * signal / (signal + background)
    return where(photons > 0, ratio, max(ratio, -DEAD_LIMIT))


@each
def _log_likelihood_ratio(i, j, frame: Frame, state: floats4d, terms: floats4d, out: floats3d):
    counts, exposure, given = frame.counts[i, j], frame.exposure[i, j], full(0.0)
    for k in range(state.shape[1]):
        given += state[i, k, INTENSITY, j] * exposure
    for k in range(state.shape[1]):
        expected = state[i, k, INTENSITY, j] * exposure
        others = given - expected if state.shape[1] > 1 else full(0.0)
        likeness = where(others > 0, SHARED_LIKENESS, LIKENESS)
        ratio = llr(terms[i, k, VALUE, j], left(counts, others), expected, likeness, frame)
        out[i, k, j] = where(expected > 0, ratio, 0)


def log_likelihood_ratio(work, frame, state, terms):
    ratios = work.map("ratios", work.surfaces)
    _log_likelihood_ratio(frame, state, terms, ratios)
    return ratios
