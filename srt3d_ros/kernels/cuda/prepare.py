"""Sketches as the iterations want them, and what known surfaces leave of them: once a frame, by torch."""

import math

import torch

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.cuda.device import borrow


def prepare(sums, photons, equaliser, used, scratch=None, taken=None, shown=None):
    rows, cols, m = sums.shape
    padded_rows, padded_cols = maps.padded_shape(rows, cols)
    matched = borrow(scratch, "matched", (padded_rows, 2 * m, padded_cols), True)
    counts = borrow(scratch, "counts", (padded_rows, padded_cols), True)
    z, image = sums * equaliser, maps.crop(matched, rows, cols)
    if taken is not None:
        z = z - taken[..., None] * shown
    z = z.transpose(1, 2)
    image[:, :m], image[:, m:] = z.real, z.imag
    maps.crop(counts, rows, cols)[:] = photons.to(torch.float32) * used
    return matched, counts


def phases(frame, depth):
    """Cosines and sines of ω_l t [rows, m, cols] of depths t [rows, cols]."""
    turns = frame.bin_frequencies[:, None] * depth[:, None]
    angle = 2 * math.pi * (turns - turns.round())
    return torch.cos(angle), torch.sin(angle)


def residual(frame, state, terms, layer, scratch=None):
    m, rest = len(frame.energy), borrow(scratch, "residual", frame.matched.shape)
    rest.copy_(frame.matched)
    for k in range(state.shape[1]):
        if k != layer:
            signal = terms[:, k, maps.VALUE].clamp(min=0) / frame.total_energy
            shown = frame.energy[:, None] * signal[:, None]
            cosine, sine = phases(frame, state[:, k, maps.DEPTH])
            rest[:, :m] -= shown * cosine
            rest[:, m:] -= shown * sine
    return rest
