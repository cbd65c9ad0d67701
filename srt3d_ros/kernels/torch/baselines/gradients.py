"""The baselines' gradient step on each pixel's sketch (`pixelwise`), and the scene's usual intensity and depth."""

import torch

from srt3d_ros.kernels.constants import INTENSITY_RATE, TINY
from srt3d_ros.kernels.torch.arithmetic import explained, turned, waves
from srt3d_ros.kernels.torch.fusing import fused


@fused
def pixelwise(frame, table, rate, usual, depth, intensity, faintest=0.0):
    """Gradient step on n (z − Ψ_θ)ᵀ W (z − Ψ_θ): t += rate Δ_rt s / max(s, usual g)², r += INTENSITY_RATE Δ_r / g.

    Of d_l = (z_l − g Σ_k r_k |ĥ_l|² exp(i ω_l t_k)) exp(−i ω_l t) the table's rows make
    Δ_rt = a₀ · Re d + a₁ · Im d and Δ_r = a₂ · Re d + a₃ · Im d (`core/baselines/sketched.py`). s = g max(r, the new
    r). A step in depth is at most δ, an intensity at least 0. All points move at once.
    """
    light, there = frame.exposure[:, None], intensity > 0
    wave, z = waves(frame, depth), frame.matched[:, None].chunk(2, dim=2)                # [rows, K, m, cols]
    given = explained(frame, wave, light * intensity)
    re, im = turned([part - gives.sum(dim=1, keepdim=True) for part, gives in zip(z, given)], wave)
    last = len(table) - 1
    share = light * intensity / frame.counts[:, None].clamp(min=1)
    level = (share.clamp(max=1) * last + 0.5).long().clamp(0, last)         # of NaN it may be anything
    a = (table[level] if last else table[0].expand(*depth.shape, -1, -1)).movedim(2, -1)    # [rows, K, 4, m, cols]
    shift, change = ((a[:, :, at] * re + a[:, :, at + 1] * im).sum(dim=2) for at in (0, 2))

    light = light.clamp(min=TINY)
    grown = intensity + INTENSITY_RATE * change / light
    signal = torch.maximum(intensity, grown) * light
    least = torch.maximum(signal, usual * light)
    move = (rate * shift * signal / (least * least + TINY)).clamp(-frame.resolution_bins, frame.resolution_bins)
    grown = torch.where(there, grown.clamp(min=0), intensity)
    return torch.where(there, (depth + move) % frame.num_bins, depth), torch.where(grown >= faintest, grown, 0)


@fused
def usual_intensity(intensity, exposure):
    """Mean intensity of the strongest points, of [rows, K, cols], of the pixels in use; 0 if there is none."""
    used = exposure > 0
    return (intensity.amax(dim=1) * used).sum() / used.sum().clamp(min=1)


@fused
def median_depth(depth, intensity):
    """The median depth of the points [rows, K, cols], bins; 0 if there is none."""
    there = intensity > 0
    ordered, number = torch.where(there, depth, torch.inf).flatten().sort().values, there.sum()
    middle = torch.stack([(number - 1).clamp(min=0) // 2, number // 2])
    return torch.where(number > 0, ordered.take(middle).mean(), 0)
