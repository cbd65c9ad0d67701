"""What the steps share: waves, a pixel's statistics as pairs of reals, and what makes depths one surface's."""

import math

import torch

from srt3d_ros.kernels.maps import BLOCK, INTENSITY, MARGIN, MAX_STD, STD


def waves(frame, depth):
    """cos ω_l t and sin ω_l t, [..., m, cols] each, of depths [..., cols]."""
    turns = frame.bin_frequencies[:, None] * depth[..., None, :]
    angle = 2 * math.pi * (turns - turns.round())
    return torch.cos(angle), torch.sin(angle)


def product(a, b):
    """Of complex numbers as pairs of reals [..., 2]: its real and its imaginary parts."""
    (a_re, a_im), (b_re, b_im) = a.unbind(-1), b.unbind(-1)
    return a_re * b_re - a_im * b_im, a_re * b_im + a_im * b_re


def pad(image):
    """`maps.pad` of [rows, …, cols]."""
    right = -image.shape[-1] % BLOCK + MARGIN
    return torch.nn.functional.pad(image, (MARGIN, right, *(0, 0) * (image.ndim - 2), MARGIN, MARGIN))


def noise_ratio(frame, depth):
    """By how much scores at these depths exceed standard deviations: `clutter` at the nearest bin."""
    return 1.0 if frame.clutter is None else frame.clutter[depth.round().long() % frame.num_bins]


def wrap(difference, period):
    """The difference of two depths on a circle."""
    return difference - period * (difference / period).round()


def agreement(difference, variance):
    """How far depths are one surface's, 0 … 1; `variance`, above 0, is the sum of what each may be off, squared."""
    return (1 - difference**2 / variance).clamp(min=0)


def has_depth(record, period):
    """Which of some surfaces [FIELDS, …] exist, at depths that mean anything."""
    return (record[INTENSITY] > 0) & (record[STD] < MAX_STD * period)
