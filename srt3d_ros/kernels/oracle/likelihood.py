"""What a pixel's own photons say of its surfaces: `expand`, `evidence` and `llr`."""

import math

import torch

from srt3d_ros.kernels.constants import DEAD_VOTES, EPSILON, VOTE
from srt3d_ros.kernels.maps import DEPTH, INTENSITY
from srt3d_ros.kernels.oracle.arithmetic import as_complex, waves
from srt3d_ros.kernels.oracle.windows import by_rows

NUMBERS = 16           # that `expand` holds for each frequency of a point, about


def expand(frame, state):
    """The data term of every point to second order, f(t + d) ≈ v + s d − b d² / 2, at the depth t that it shows.

    With z'_l = (z_l − g Σ_{o ≠ k} r_o |ĥ_l|² exp(i ω_l t_o)) exp(−i ω_l t_k), what other surfaces leave of a pixel:
    v = Σ Re z'_l = R(z, t), s = Σ ω_l Im z'_l, b = Σ ω_l² Re z'_l.

    Returns:
        float32 [rows', K, TERMS, cols']: v, s, b, and n, n, g; 0 where there is no point.
    """
    numbers = NUMBERS * len(frame.energy) * state.shape[1]
    return by_rows(_expand, numbers * state[0, 0, 0].nbytes, frame, state, margin=0)[0]


def _expand(frame, state):
    depth, intensity = state[:, :, DEPTH], state[:, :, INTENSITY]
    omega, phases = 2 * math.pi * frame.bin_frequencies[:, None], waves(frame, depth)
    shown = frame.energy[:, None] * (frame.exposure[:, None] * intensity)[:, :, None] * phases
    along = (as_complex(frame.matched)[:, None] - shown.sum(dim=1, keepdim=True) + shown) * phases.conj()
    counts, exposure = (values[:, None].expand_as(depth) for values in (frame.counts, frame.exposure))
    terms = [along.real.sum(dim=2), (omega * along.imag).sum(dim=2), (omega**2 * along.real).sum(dim=2), counts, counts,
             exposure]
    return (torch.stack(terms, dim=2).masked_fill((intensity <= 0)[:, :, None], 0),)


def evidence(response, photons, squares, frame):
    """The score of a response V = Σ w R of photons, p = Σ w n, N = Σ w² n: p / √N · ρ(V₊ / p), standard deviations.

    exp(−score² / 2) bounds the probability that background alone responds so; N = p for photons that count as one.
    """
    photons, table, steps = photons.clamp(min=EPSILON), frame.background_table, len(frame.background_table) - 1
    at = (response / (photons * frame.max_response)).clamp(0, 1) * steps
    low = at.long().clamp(max=steps - 1)
    rare = table[low] + (at - low) * (table[low + 1] - table[low])
    return photons / squares.clamp(min=EPSILON).sqrt() * rare


def llr(response, photons, expected, likeness, frame):
    """p ρ(v / p)² / 2 − D μ I₁ / (μ I₁ + (p − μ)₊ I₀): log-likelihood ratio of a surface and "background alone", nats.

    v ≥ 0 is the response of the pixel's photons at the surface's depth, p their number, at least 1/2. μ is s = v / E,
    clipped to within a factor `likeness` of `expected`, the signal photons that the surface should give; D = μ − s +
    s ln(s / μ) is half the deviance of a Poisson number. A pixel without photons gives at least −DEAD_VOTES ·
    VOTE.

    Args:
        photons: of the pixel, those of its other surfaces left out; 0 if it has seen none at all.
    """
    value, n = response.clamp(min=0), photons.clamp(min=0.5)
    seen = value / frame.total_energy
    likely = torch.minimum(torch.maximum(seen, expected / likeness), expected * likeness)
    deviance = likely - seen + torch.xlogy(seen, seen / likely)
    by_signal = likely * frame.intensity_moments[0]
    by_background = (n - likely).clamp(min=0) * frame.intensity_moments[1]
    ratio = evidence(value, n, n, frame)**2 / 2 - deviance * by_signal / (by_signal + by_background)
    return torch.where(photons <= 0, ratio.clamp(min=-DEAD_VOTES * VOTE), ratio)
