"""What the torch kernels share: waves, complex products, and whether depths belong to one surface."""

import math

import torch

from srt3d_ros.kernels.maps import INTENSITY, MAX_STD, STD


def waves(frame, depth):
    """cos ω_l t and sin ω_l t, [..., m, cols] each, of depths [..., cols]."""
    turns = frame.bin_frequencies[:, None] * depth[..., None, :]
    angle = 2 * math.pi * (turns - turns.round())
    return torch.cos(angle), torch.sin(angle)


def explained(frame, wave, signal):
    """What surfaces with these waves and so many signal photons, [..., cols], add to z: real and imaginary parts."""
    gives = frame.energy[:, None] * signal[..., None, :]
    return [gives * part for part in wave]


def turned(z, wave):
    """z exp(−i ω_l t), of real and imaginary parts of z, and of waves."""
    (re, im), (cosine, sine) = z, wave
    return re * cosine + im * sine, im * cosine - re * sine


def product(a, b):
    """Real and imaginary parts of the product of complex numbers, which are pairs of reals [..., 2]."""
    (a_re, a_im), (b_re, b_im) = a.unbind(-1), b.unbind(-1)
    return a_re * b_re - a_im * b_im, a_re * b_im + a_im * b_re


def noise_ratio(frame, depth):
    """c(t), by which scores at these depths exceed standard deviations: `clutter` at the nearest bin."""
    return by_bin(frame.clutter, depth)


def by_bin(table, depth):
    """The entries [T] of a table at the bins nearest to depths, or to distances, around the circle."""
    return table[depth.round().long() % len(table)]


def wrap(difference, period):
    """A difference of depths on the circle, in [−period / 2, period / 2]."""
    return difference - period * (difference / period).round()


def agreement(difference, variance):
    """How well depths fit one surface, 0 … 1; `variance`, above 0, is the sum of the squares that each may be off."""
    return (1 - difference**2 / variance).clamp(min=0)


def has_depth(record, period):
    """Which of these surfaces, [FIELDS, …], exist and have a known depth."""
    return (record[INTENSITY] > 0) & (record[STD] < MAX_STD * period)
