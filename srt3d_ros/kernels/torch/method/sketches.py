"""Matched sketches, what surfaces leave of them, and the data terms of points."""

import math

import torch

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import EPSILON, TINY
from srt3d_ros.kernels.maps import DEPTH, GRADIENT, INTENSITY, VALUE
from srt3d_ros.kernels.torch.arithmetic import by_bin, explained, product, turned, waves
from srt3d_ros.kernels.torch.fusing import fused
from srt3d_ros.kernels.torch.method.finalise import local_mean
from srt3d_ros.kernels.torch.method.windows import inner, pad


@fused
def prepare(sums, photons, equaliser, used, taken=None, passed=None, mean=None):
    """z_l = equaliser_l · sums_l − taken · passed_l β_l, and used · n, padded with 0."""
    z = product(sums, equaliser)
    if taken is not None:
        z = (part - taken[..., None] * shown for part, shown in zip(z, product(passed, mean)))
    return pad(torch.cat(tuple(z), dim=-1).movedim(2, 1)), pad(photons * used)


@fused
def residual(frame, state, terms, layer):
    """z_l − Σ_{k ≠ layer} (v_k / E)₊ |ĥ_l|² exp(i ω_l t_k): each surface with the intensity by its own pixel.

    Intensities of pools would take too much from some pixels, and the filter would respond half a period away.
    """
    signal = terms[:, :, maps.VALUE].clamp(min=0) / frame.total_energy
    others = torch.arange(state.shape[1], device=state.device)[:, None] != layer
    given = explained(frame, waves(frame, state[:, :, maps.DEPTH]), signal * others)
    return frame.matched - torch.cat(given, dim=2).sum(dim=1)


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


@fused
def unexplained(frame, points, rest, taken, passed):
    """Sums over the pixels of what the points do not explain; y_l = g Σ_k r_k exp(i ω_l t_k), w = b̄ / n̄.

    `own` are the photons of `rest` in used pixels; `taken` is `own` if None.

    Returns:
        float32 [4m + 4], sums over the pixels: of w conj(q_l) (z_l − |ĥ_l|² y_l), real parts before imaginary ones;
        of w y_l in the same way; of w · own, w · taken, w² n and Σ_l |z_l − |ĥ_l|² y_l|² / |ĥ_l|² n̄; b̄ and n̄ are
        `local_mean` of own and of n.
    """
    counts, light, matched, depth, intensity = (inner(frame, values) for values in (
        frame.counts, frame.exposure, frame.matched, points[:, :, DEPTH], points[:, :, INTENSITY]))
    used = (light > 0).to(light.dtype)
    own, energy = rest * used, frame.energy[:, None]
    gives = (intensity * light[:, None])[:, :, None]
    shown = [(gives * wave).sum(dim=1) for wave in waves(frame, depth)]                        # [rows, m, cols] each
    re, im = (z - energy * part for z, part in zip(matched.chunk(2, dim=1), shown))
    around = local_mean(counts, used).clamp(min=EPSILON)
    share = local_mean(own, used) / around
    misfit = ((re**2 + im**2) / energy.clamp(min=TINY) / around[:, None]).sum()
    q_re, q_im = passed.movedim(2, 1).unbind(-1)
    maps = q_re * re + q_im * im, q_re * im - q_im * re, *shown
    sums = [(share * own).sum(), (share * (own if taken is None else taken)).sum(), (share**2 * counts).sum(), misfit]
    return torch.cat([*((share[:, None] * values).sum(dim=(0, 2)) for values in maps), torch.stack(sums)])
