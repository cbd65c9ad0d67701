"""The baselines' gradient steps: `pixelwise` and `poisson`."""

import torch

from srt3d_ros.kernels.constants import INTENSITY_RATE
from srt3d_ros.kernels.oracle.arithmetic import TINY, as_complex, waves


def pixelwise(frame, table, rate, usual, depth, intensity):
    """Gradient step on n (z − Ψ_θ)ᵀ W (z − Ψ_θ): t += rate Δ_rt s / max(s, usual g)², r += INTENSITY_RATE Δ_r / g.

    Of d_l = (z_l − g Σ_k r_k |ĥ_l|² exp(i ω_l t_k)) exp(−i ω_l t) the table's rows make
    Δ_rt = a₀ · Re d + a₁ · Im d and Δ_r = a₂ · Re d + a₃ · Im d (`core/baselines/weighting.py`). s = g max(r, the new
    r). A step in depth is at most δ, an intensity at least 0. All points move at once.

    Args:
        frame: without padding.
        table: float32 [levels, 4, m], a for shares g r / n from 0 to 1.
        rate: of the full step in depth.
        usual: intensity below which points move less than their curvature allows; 0 for none.
        depth, intensity: float32 [rows, K, cols], bins and photons; changed in place.
    """
    seen, reach, phases = frame.exposure.clamp(min=TINY)[:, None], frame.resolution_bins, waves(frame, depth)
    expected = frame.exposure[:, None] * intensity
    rest = as_complex(frame.matched) - frame.energy[:, None] * (expected[:, :, None] * phases).sum(dim=1)
    along = rest[:, None] * phases.conj()                                               # [rows, K, m, cols]
    share = (expected / frame.counts.clamp(min=1)[:, None]).clamp(max=1)
    weights = table[(share * (len(table) - 1) + 0.5).long()].permute(3, 0, 1, 4, 2)     # [4, rows, K, m, cols]
    shift = (weights[0] * along.real + weights[1] * along.imag).sum(dim=2)
    change = (weights[2] * along.real + weights[3] * along.imag).sum(dim=2)
    grown = intensity + change * INTENSITY_RATE / seen
    signal = seen * torch.maximum(intensity, grown)
    move = rate * shift * signal / (torch.maximum(signal, usual * seen)**2 + TINY)
    there = intensity > 0
    depth[:] = torch.where(there, (depth + move.clamp(-reach, reach)) % frame.num_bins, depth)
    intensity[:] = torch.where(there, grown.clamp(min=0), intensity)


def poisson(frame, background, rate, usual, depth, intensity):
    """Gradient step on Σ_p ln(Σ_k r_k h(x_p − t_k) + b) − g Σ_k r_k, in every pixel.

    With q_pk = r_k h(x_p − t_k) / (Σ r h + b) and s_k = Σ_p q_pk:
    t_k += rate · (−Σ_p q_pk h′/h) / (max(s_k, usual g) J), at most 1/√J, J the information;
    ln r_k += INTENSITY_RATE · (s_k − g r_k) / max(g r_k, usual g), at most 1.

    Args:
        background: float32 [rows, cols], b, photons per bin at g = 1.
        rate: of the full step in depth.
        usual: intensity below which the curvatures at `usual` are taken.
        depth, intensity: float32 [rows, K, cols], bins and photons; changed in place.

    Returns:
        float32 [rows, cols], Σ_p b / (Σ r h + b): photons of the background.
    """
    rows, surfaces, cols = depth.shape
    owner = torch.repeat_interleave(torch.arange(rows * cols, device=depth.device), frame.starts.diff())
    row, col = owner // cols, owner % cols
    r, b = intensity[row, :, col], background[row, col]                                 # [N, K], [N]
    place = (frame.toa[:, None] - depth[row, :, col] + frame.ref) % frame.num_bins
    place = torch.where(place > frame.num_bins - 1, place - frame.num_bins, place)      # rises before the first entry
    h, rise = (_between_entries(values, owner, place) for values in (frame.irf, frame.slope))
    total = b + (r * h).sum(dim=1)
    share = torch.where(total > 0, 1 / total, 0)[:, None]
    each = torch.cat([b[:, None] * share, r * h * share, -r * rise * share], dim=1)
    sums = torch.segment_reduce(each, "sum", offsets=frame.starts, axis=0).view(rows, cols, -1).movedim(2, 1)
    stray, signal, score = sums.split([1, surfaces, surfaces], dim=1)

    seen, there = frame.exposure[:, None], (frame.exposure[:, None] > 0) & (intensity > 0)
    reach = frame.information**-0.5
    move = rate * score / (torch.maximum(signal, usual * seen) * frame.information + TINY)
    expected = intensity * seen
    change = INTENSITY_RATE * (signal - expected) / (torch.maximum(expected, usual * seen) + TINY)
    depth[:] = torch.where(there, (depth + move.clamp(-reach, reach)) % frame.num_bins, depth)
    intensity[:] = torch.where(there, intensity * change.clamp(max=1).exp(), intensity)
    return stray[:, 0] * (frame.exposure > 0)


def _between_entries(values, owner, place):
    """Of each photon's row of `values`, at a place from −1 on; 0 outside."""
    low, last = place.floor().long(), values.shape[1] + 1
    padded, own = torch.nn.functional.pad(values, (1, 1)), (owner if len(values) > 1 else 0 * owner)[:, None]
    part = place - low
    return (1 - part) * padded[own, (low + 1).clamp(max=last)] + part * padded[own, (low + 2).clamp(max=last)]
