"""What a reconstruction leaves of its frame, added up by torch: the background's estimate is made of it."""

import torch

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.cuda.arithmetic import EPSILON, TINY
from srt3d_ros.kernels.cuda.prepare import phases


def unexplained(frame, state, intensity, own, taken, background, photons, passed):
    counts, exposure, depth, matched = (maps.crop(values, *frame.shape) for values in (
        frame.counts, frame.exposure, state[:, :, maps.DEPTH], frame.matched))
    cosine = sine = 0
    for k in range(intensity.shape[1]):
        signal, turned = (intensity[:, k] * exposure)[:, None], phases(frame, depth[:, k])
        cosine, sine = cosine + signal * turned[0], sine + signal * turned[1]
    points = torch.cat([cosine, sine], dim=1)
    rest = matched - torch.cat([frame.energy, frame.energy])[:, None] * points
    re, im = rest.chunk(2, dim=1)
    c, d = passed.real.transpose(1, 2), passed.imag.transpose(1, 2)
    around = photons.clamp(min=EPSILON.value)
    share = background / around
    misfit = (re**2 + im**2) / frame.energy.clamp(min=TINY.value)[:, None] / around[:, None]
    sums = (torch.cat([re * c + im * d, im * c - re * d, points], dim=1) * share[:, None]).sum(dim=(0, 2))
    rest = [(share * own).sum(), (share * taken).sum(), (share**2 * counts).sum(), misfit.sum()]
    return torch.cat([sums, torch.stack(rest)])
