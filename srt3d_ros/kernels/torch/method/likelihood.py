"""Evidence of a pixel's own photons for its surfaces: `log_likelihood_ratio`."""


import torch

from srt3d_ros.kernels.constants import DEAD_LIMIT, EPSILON, LIKENESS
from srt3d_ros.kernels.maps import INTENSITY, VALUE
from srt3d_ros.kernels.torch.fusing import fused


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
