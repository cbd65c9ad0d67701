"""Ghosts: further surfaces of a pixel that are what a wrong impulse response (IRF) leaves of stronger ones."""

import torch

from srt3d_ros.kernels.constants import EPSILON, WRONG_SHAPE
from srt3d_ros.kernels.maps import DEPTH, INTENSITY
from srt3d_ros.kernels.torch.arithmetic import by_bin
from srt3d_ros.kernels.torch.fusing import fused
from srt3d_ros.kernels.torch.method.windows import images, inner


def drop_ghosts(frame, state) -> None:
    """Remove ghosts, in place: r = 0. The surfaces of a pixel still come first, without a gap.

    If the IRF is ĥ (1 + d) instead of ĥ, a surface of intensity r₁ leaves r₁ ĥ d, and a further one is fitted to it. d
    is the same for all photons: the more are pooled, the surer the ghost, and no score tells it from a surface. Its
    size does. Of a surface at distance Δ, let u(Δ) be the part that no correction of the first one's intensity, depth,
    width and skew explains (‖u‖ / ‖ĥ‖ is `frame.unlike`). What d leaves beyond these shows a second
    surface with r₂ ‖u(Δ)‖ ≤ ‖d‖ r₁ (Cauchy-Schwarz). So a surface goes if

        r_k Π_j ‖u(t_k − t_j)‖ < WRONG_SHAPE · min(Σ_j r_j, n / g),    j: the pixel's stronger surfaces.

    n / g, because the pool makes the halo of a retro-reflector brighter than all of a pixel's photons.
    """
    if state.shape[1] > 1:          # with one surface a pixel, nothing is to be launched
        _drop_ghosts(frame, state)


@fused
def _drop_ghosts(frame, state) -> None:
    point = images(frame, state)
    depth, intensity = point[:, DEPTH], point[:, INTENSITY].clone()
    light = inner(frame, frame.counts) / inner(frame, frame.exposure).clamp(min=EPSILON)
    for k in range(len(point)):
        stronger, shown = torch.zeros_like(light), intensity[k]
        for o in (*range(k), *range(k + 1, len(point))):
            is_stronger = (intensity[o] > intensity[k]) | ((intensity[o] == intensity[k]) & (o < k))
            is_stronger = is_stronger & (intensity[o] > 0)
            stronger = stronger + intensity[o] * is_stronger
            shown = torch.where(is_stronger, shown * by_bin(frame.unlike, depth[k] - depth[o]), shown)
        point[k, INTENSITY].masked_fill_(shown < WRONG_SHAPE * torch.minimum(stronger, light), 0)
    for last in range(len(point) - 1, 0, -1):
        for k in range(last):
            low, high = point[k].clone(), point[k + 1].clone()
            gap = (low[INTENSITY] <= 0) & (high[INTENSITY] > 0)
            point[k].copy_(torch.where(gap, high, low))
            point[k + 1].copy_(torch.where(gap, low, high))
