"""The matched filter on a sketch, and where it peaks: `match`."""

import torch

from srt3d_ros.kernels.constants import EPSILON
from srt3d_ros.kernels.torch.arithmetic import explained, waves
from srt3d_ros.kernels.torch.fusing import fused


@fused
def match(frame, surfaces):
    """t_k = arg max_t R(z, t), s_k = R(z, t_k) / E, then z_l −= s_k |ĥ_l|² exp(i ω_l t_k); for k = 1 … K.

    R has no frequency above max k_l: its peak is found on a grid of 4 max k_l cells (rounded up to 16), and by a
    parabola through the highest one and its neighbours. The intensity is (s_k)₊ / g, 0 where g = 0.
    """
    z, found = frame.matched, []
    for _ in range(surfaces):
        depth, value = peaks(z, frame)
        found.append((depth, value / frame.total_energy))
        z = z - torch.cat(explained(frame, waves(frame, depth), found[-1][1]), dim=1)
    depth, signal = (torch.stack(values, dim=1) for values in zip(*found))
    light = frame.exposure[:, None]
    return depth, signal.clamp(min=0) / light.clamp(min=EPSILON) * (light > 0)


def peaks(z, frame):
    """Place (bins) and height of the highest peak of R(z, t), [..., cols] each, of z [..., 2m, cols]."""
    cells, sketches = len(frame.filters), z.movedim(-2, 0)
    response = (frame.filters @ sketches.flatten(1)).unflatten(1, sketches.shape[1:])
    peak, top = response.max(dim=0, keepdim=True)
    before, after = (response.gather(0, (top + step) % cells) for step in (-1, 1))
    bend = before - 2 * peak + after
    shift = torch.where(bend < 0, (before - after) / 2 / bend, 0)
    height = peak - (before - after) / 4 * shift
    return ((top + shift) * (frame.num_bins / cells))[0], height[0]
