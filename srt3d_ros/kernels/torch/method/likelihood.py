"""Evidence of a pixel's own photons for its surfaces: `expand` and `log_likelihood_ratio`."""

import math

import torch

from srt3d_ros.kernels.constants import DEAD_LIMIT, EPSILON, LIKENESS
from srt3d_ros.kernels.maps import DEPTH, GRADIENT, INTENSITY, VALUE
from srt3d_ros.kernels.torch.arithmetic import by_bin, explained, turned, waves
from srt3d_ros.kernels.torch.fusing import fused


@fused
def expand(frame, state):
    """The data term of every point to second order, f(t + d) ≈ v + s d − b d² / 2, at the depth t that it shows.

    With z'_l = (z_l − g Σ_{o ≠ k} r_o |ĥ_l|² exp(i ω_l t_o)) exp(−i ω_l t_k), what other surfaces leave of a pixel:
    v = Σ Re z'_l = R(z, t), s = Σ ω_l Im z'_l, b = Σ ω_l² Re z'_l.
    """
    depth, intensity = state[:, :, DEPTH], state[:, :, INTENSITY]
    omega, wave, z = 2 * math.pi * frame.bin_frequencies[:, None], waves(frame, depth), frame.matched[:, None]
    z = z.chunk(2, dim=2)
    if state.shape[1] > 1:
        own = explained(frame, wave, frame.exposure[:, None] * intensity)
        z = [part - gives.sum(dim=1, keepdim=True) + gives for part, gives in zip(z, own)]
    re, im = turned(z, wave)
    counts, exposure = (values[:, None].expand_as(depth) for values in (frame.counts, frame.exposure))
    terms = [re.sum(dim=2), (omega * im).sum(dim=2), (omega**2 * re).sum(dim=2), counts, counts, exposure]
    return torch.stack(terms, dim=2).masked_fill((intensity <= 0)[:, :, None], 0)


def solve_pairs(frame, state, terms) -> None:
    """Make values and slopes of `expand` those of a step of all surfaces of a pixel together, in place, pair by pair.

    In turns, surfaces whose pulses overlap hardly move apart. Together, those of a pair at distance Δ = t_o − t_k step
    by X = g E Δr and Y = g √(E C) r Δt, which solve the normal equations of |z − g Σ r ĥ exp(i ω t)|²,

        X_k + c X_o − q Y_o = v_k − g E r_k,    Y_k + p Y_o + q X_o = δ s_k,    and with k, o exchanged and q → −q,
        c = Σ |ĥ_l|² cos(ω_l Δ) / E,  p = Σ ω_l² |ĥ_l|² cos(ω_l Δ) / C,  q = Σ ω_l |ĥ_l|² sin(ω_l Δ) / √(E C),

    all three times OVERLAP. Sums and differences of the two are independent. Then v_k ← g E r_k + X_k, s_k ← Y_k / δ.
    """
    for other in range(1, state.shape[1]):
        for own in range(other):
            _solve_pair(frame, state[:, own], state[:, other], terms[:, own], terms[:, other])


@fused
def _solve_pair(frame, own, other, own_terms, other_terms) -> None:
    width, energy = frame.resolution_bins, frame.exposure * frame.total_energy
    c, p, q = (by_bin(table, other[:, DEPTH] - own[:, DEPTH]) for table in frame.overlap)
    one, two = own[:, INTENSITY] * energy, other[:, INTENSITY] * energy
    a, b = own_terms[:, VALUE] - one, other_terms[:, VALUE] - two
    s, t = own_terms[:, GRADIENT] * width, other_terms[:, GRADIENT] * width
    (alike, apart), (unlike, together) = _solved(a + b, s - t, c, p, q), _solved(a - b, s + t, -c, -p, -q)
    both = (one > 0) & (two > 0)
    for terms, signal, sign in ((own_terms, one, 1), (other_terms, two, -1)):
        terms[:, VALUE] = torch.where(both, signal + (alike + sign * unlike) / 2, terms[:, VALUE])
        terms[:, GRADIENT] = torch.where(both, (together + sign * apart) / (2 * width), terms[:, GRADIENT])


def _solved(a, b, c, p, q):
    """X, Y of (1 + c) X + q Y = a, q X + (1 − p) Y = b."""
    det = (1 + c) * (1 - p) - q * q
    return ((1 - p) * a - q * b) / det, ((1 + c) * b - q * a) / det


def evidence(response, photons, squares, frame):
    """The score of a response V = Σ w R of photons, p = Σ w n, N = Σ w² n: p / √N · ρ(V₊ / p), standard deviations.

    exp(−score² / 2) bounds the probability that background alone responds so; N = p for photons that count as one.
    """
    photons, table, steps = photons.clamp(min=EPSILON), frame.background_table, len(frame.background_table) - 1
    at = (response / (photons * frame.max_response)).clamp(0, 1) * steps
    low = at.long().clamp(0, steps - 1)         # of NaN it may be anything
    rare = table[low] + (at - low) * (table[low + 1] - table[low])
    return photons / squares.clamp(min=EPSILON).sqrt() * rare


def llr(response, photons, expected, likeness, frame):
    """Log-likelihood ratio of a surface of about `expected` photons and of "background alone", nats.

    Args:
        response: of the pixel's photons to the matched filter at the surface's depth.
        photons: of the pixel, those of its other surfaces left out; 0 if it has seen none at all.
        expected: signal photons that the surface should give, to within the factor `likeness`.
    """
    value, n = response.clamp(min=0), photons.clamp(min=0.5)
    seen = value / frame.total_energy
    likely = torch.minimum(torch.maximum(seen, expected / likeness), expected * likeness)
    deviance = likely - seen + torch.xlogy(seen, seen / likely)
    by_signal = likely * frame.intensity_moments[0]
    by_background = (n - likely).clamp(min=0) * frame.intensity_moments[1]
    ratio = evidence(value, n, n, frame)**2 / 2 - deviance * by_signal / (by_signal + by_background)
    return torch.where(photons <= 0, ratio.clamp(min=-DEAD_LIMIT), ratio)


@fused
def log_likelihood_ratio(frame, state, terms):
    """Log-likelihood ratio of each point's own photons against "background alone", nats.

        p ρ(v / p)² / 2 − D μ I₁ / (μ I₁ + (p − μ)₊ I₀)

    v ≥ 0 is the response of `expand`. p is n less the photons of the pixel's other surfaces, at least 1/2.
    μ is s = v / E, clipped to within a factor LIKENESS of g r (its square if there are other surfaces);
    D = μ − s + s ln(s / μ) is half the deviance of a Poisson number. A pixel with n = 0
    gives at least −DEAD_LIMIT.
    """
    gives = state[:, :, INTENSITY] * frame.exposure[:, None]
    others = gives.sum(dim=1, keepdim=True) - gives
    likeness = torch.where(others > 0, LIKENESS**2, LIKENESS)
    counts = frame.counts[:, None]
    photons = torch.where(counts > 0, (counts - others).clamp(min=0.5), 0)
    ratio = llr(terms[:, :, VALUE], photons, gives, likeness, frame)
    return ratio.masked_fill(gives <= 0, 0)
