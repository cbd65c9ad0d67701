"""What a pixel's own photons say of its surfaces: `expand`, `log_likelihood_ratio` and `trim`."""

import math

import numpy as np
import torch

from srt3d_ros.kernels.constants import EPSILON, LIKENESS, RIM, SPREAD, VOTE, VOTE_RADIUS
from srt3d_ros.kernels.maps import COUNTS, DEPTH, EXPOSURE, INTENSITY, VALUE, crop
from srt3d_ros.kernels.oracle.arithmetic import as_complex, has_depth, noise_ratio, waves
from srt3d_ros.kernels.oracle.blur import blur
from srt3d_ros.kernels.oracle.windows import by_rows

NUMBERS = 16           # that `expand` holds for each frequency of a point, about
NEAREST, AROUND = np.ones(3, np.float32), np.ones(2 * VOTE_RADIUS + 1, np.float32)      # of `trim`


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
    return torch.where(photons <= 0, ratio.clamp(min=-VOTE), ratio)


def log_likelihood_ratio(frame, state, terms):
    """Of each point's own photons, against "background alone": p ρ(v / p)² / 2 − D μ I₁ / (μ I₁ + (p − μ)₊ I₀).

    v ≥ 0 is the response of `expand`. p is n less the photons of the pixel's other surfaces, at least 1/2.
    μ is s = v / E, clipped to within a factor LIKENESS of g r (its square if there are other surfaces);
    D = μ − s + s ln(s / μ) is half the deviance of a Poisson number. A pixel with n = 0
    gives at least −VOTE.

    Returns:
        float32 [rows', K, cols'], nats; 0 where there is no point.
    """
    gives = state[:, :, INTENSITY] * frame.exposure[:, None]
    others = gives.sum(dim=1, keepdim=True) - gives
    likeness = torch.where(others > 0, LIKENESS**2, LIKENESS)
    counts = frame.counts[:, None]
    photons = torch.where(counts > 0, (counts - others).clamp(min=0.5), 0)
    ratio = llr(terms[:, :, VALUE], photons, gives, likeness, frame)
    return ratio.masked_fill(gives <= 0, 0)


def trim(frame, state, terms, enough):
    """r = 0 for the points of rims that the photons of the rim do not pay for; in place.

    A pixel with a surface is at the rim if RIM of the 8 around are used (g > 0) and have none. What the pixels of
    the rim within VOTE_RADIUS (a square) show is pooled: V = Σ v, p = Σ n, μ = Σ g r, over their points. A point of
    the pixel goes if these photons do not show a surface of any intensity, √p ρ(V₊ / p) / c(t) ≤ `enough`, and speak
    for none rather than for one as bright as the pools of `pooled_step` make it: with this V, p and μ the ratio of
    `log_likelihood_ratio` is below 0. What lies behind is the rim then: SPREAD rounds, as far as surfaces grow in an
    iteration. `terms` are `expand` of the state.
    """
    view, terms, used = (crop(values, *frame.shape) for values in (state, terms, frame.exposure > 0))
    intensity = view[:, :, INTENSITY]
    for _ in range(SPREAD):
        there = has_depth(view.movedim(2, 0), frame.num_bins).any(dim=1)
        blank = blur((used & ~there)[:, None].to(state.dtype), NEAREST)[:, 0]
        rim = there & (blank > RIM - 0.5)
        own = torch.stack([terms[:, :, VALUE], terms[:, :, COUNTS], terms[:, :, EXPOSURE] * intensity], dim=1)
        own = (own * (rim[:, None] & (intensity > 0))[:, None]).sum(dim=2)
        response, photons, expected = blur(own, AROUND).unbind(dim=1)
        some = photons.clamp(min=0.5)
        score = evidence(response, some, some, frame)
        unpaid = rim & (llr(response, photons, expected, 1, frame) < 0)
        weak = score[:, None] <= enough * noise_ratio(frame, view[:, :, DEPTH])
        intensity.masked_fill_(unpaid[:, None] & weak, 0)
