"""The baselines' gradient steps: `pixelwise` by torch, `poisson` with a warp for each pixel."""

import torch
import triton
import triton.language as tl

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cuda.arithmetic import TINY
from srt3d_ros.kernels.cuda.prepare import phases

RATE = tl.constexpr(constants.INTENSITY_RATE)
PHOTONS = 64                # of a pixel that are worked on together


def pixelwise(frame, table, rate, usual, depth, intensity):
    m, seen, reach = len(frame.energy), frame.exposure.clamp(min=TINY.value), frame.resolution_bins
    re, im = frame.matched[:, :m], frame.matched[:, m:]
    waves = [phases(frame, depth[:, k]) for k in range(depth.shape[1])]
    for k, (cosine, sine) in enumerate(waves):
        shown = frame.energy[:, None] * (frame.exposure * intensity[:, k])[:, None]
        re, im = re - shown * cosine, im - shown * sine
    for k, (cosine, sine) in enumerate(waves):
        t, r = depth[:, k], intensity[:, k]
        share = (frame.exposure * r / frame.counts.clamp(min=1)).clamp(max=1)
        weights = table[(share * (len(table) - 1) + 0.5).long()].permute(2, 0, 3, 1)        # [4, rows, m, cols]
        along, across = re * cosine + im * sine, im * cosine - re * sine
        shift = (weights[0] * along + weights[1] * across).sum(dim=1)
        change = (weights[2] * along + weights[3] * across).sum(dim=1)
        grown = r + change * RATE.value / seen
        signal = seen * torch.maximum(r, grown)
        move = rate * shift * signal / (torch.maximum(signal, usual * seen)**2 + TINY.value)
        depth[:, k] = torch.where(r > 0, (t + move.clamp(-reach, reach)) % frame.num_bins, t)
        intensity[:, k] = torch.where(r > 0, grown.clamp(min=0), r)


@triton.jit
def _poisson(starts, toa, irf, slope, ref, information, period, exposure, background, rate, usual, depth, intensity,
             stray, cols, length, SURFACES: tl.constexpr, LAYERS: tl.constexpr, PIXEL_IRF: tl.constexpr,
             PHOTONS: tl.constexpr):
    p, k = tl.program_id(0), tl.arange(0, LAYERS)
    place = (p // cols * SURFACES + k) * cols + p % cols
    seen, b = tl.load(exposure + p), tl.load(background + p)
    if seen <= 0.0:
        tl.store(stray + p, 0.0)
        return
    t = tl.load(depth + place, mask=k < SURFACES, other=0.0)
    r = tl.load(intensity + place, mask=k < SURFACES, other=0.0)
    if PIXEL_IRF:
        irf, slope = irf + p.to(tl.int64) * length, slope + p.to(tl.int64) * length
    signal = tl.zeros([LAYERS, PHOTONS], tl.float32)
    score, noise = tl.zeros_like(signal), tl.zeros([PHOTONS], tl.float32)
    last = tl.load(starts + p + 1)
    for first in range(tl.load(starts + p), last, PHOTONS):
        photon = first + tl.arange(0, PHOTONS)
        x = tl.load(toa + photon, mask=photon < last, other=0.0)
        # Where the photon lies in the IRF, between entries; from the last bin on it rises from 0 before the first one.
        at = x[None, :] - t[:, None] + ref
        at -= period * tl.floor(at / period)
        at = tl.where(at > period - 1.0, at - period, at)
        low = tl.floor(at).to(tl.int32)
        part = at - low
        lit = (r > 0.0)[:, None] & (photon < last)[None, :]
        before, after = lit & (low >= 0) & (low < length), lit & (low >= -1) & (low < length - 1)
        value = tl.load(irf + low, mask=before, other=0.0) * (1.0 - part)
        value += tl.load(irf + low + 1, mask=after, other=0.0) * part
        rise = tl.load(slope + low, mask=before, other=0.0) * (1.0 - part)
        rise += tl.load(slope + low + 1, mask=after, other=0.0) * part
        total = b + tl.sum(r[:, None] * value, axis=0)
        share = tl.where((photon < last) & (total > 0.0), 1.0 / total, 0.0)
        noise += b * share
        signal += r[:, None] * value * share[None, :]
        score -= r[:, None] * rise * share[None, :]
    tl.store(stray + p, tl.sum(noise, axis=0))
    signal, score = tl.sum(signal, axis=1), tl.sum(score, axis=1)
    reach = 1.0 / tl.sqrt(information)
    move = rate * score / (tl.maximum(signal, usual * seen) * information + TINY)
    t += tl.minimum(tl.maximum(move, -reach), reach)
    expected = r * seen
    change = (signal - expected) * RATE / (tl.maximum(expected, usual * seen) + TINY)
    there = (k < SURFACES) & (r > 0.0)
    tl.store(depth + place, t - period * tl.floor(t / period), mask=there)
    tl.store(intensity + place, r * tl.exp(tl.minimum(change, 1.0)), mask=there)


def poisson(frame, background, rate, usual, depth, intensity):
    rows, surfaces, cols = depth.shape
    stray = torch.empty_like(background)
    _poisson[(rows * cols,)](
        frame.starts, frame.toa, frame.irf, frame.slope, float(frame.ref), float(frame.information),
        float(frame.num_bins), frame.exposure, background, float(rate), float(usual), depth, intensity, stray, cols,
        frame.irf.shape[1], SURFACES=surfaces, LAYERS=triton.next_power_of_2(surfaces), PIXEL_IRF=len(frame.irf) > 1,
        PHOTONS=PHOTONS, num_warps=1)
    return stray
