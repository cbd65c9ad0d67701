"""The start: `prepare`, `match`, `search` and `residual`."""

import math
from typing import NamedTuple

import torch

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import EPSILON, START_SCORE, SURE_SCORE, VOTE
from srt3d_ros.kernels.maps import INTENSITY, RESIDUAL, SCORE, crop, state_shape
from srt3d_ros.kernels.torch.arithmetic import noise_ratio, pad, product, waves
from srt3d_ros.kernels.torch.fusing import fused
from srt3d_ros.kernels.torch.likelihood import evidence
from srt3d_ros.kernels.torch.windows import cell_sums, gaussian, window_sums


@fused
def prepare(sums, photons, equaliser, used, taken=None, passed=None, mean=None):
    """z_l = equaliser_l · sums_l − taken · passed_l β_l, and used · n: a frame's `matched` and `counts`, padded with 0.

    Args:
        sums: complex [rows, cols, m], Σ_p exp(i ω_l x_p).
        photons: float32 [rows, cols], n.
        equaliser: complex [rows or 1, cols or 1, m], conj(ĥ_l) with the pixel's delay; 0 masks it.
        used: float32 [rows, cols], 1, or 0 in masked pixels.
        taken: float32 [rows, cols], background photons to subtract; 0 in masked pixels. None for none.
        passed: complex [rows or 1, cols or 1, m], q_l: a background photon adds q_l · exp(i ω_l x) to z_l.
        mean: complex [m], β_l, the mean of exp(i ω_l x) of the background.
    """
    z = product(sums, equaliser)
    if taken is not None:
        z = (part - taken[..., None] * shown for part, shown in zip(z, product(passed, mean)))
    return pad(torch.cat(tuple(z), dim=-1).movedim(2, 1)), pad(photons * used)


@fused
def match(frame, surfaces):
    """t_k = arg max_t R(z, t), r_k = R(z, t_k) / E, then z_l −= r_k |ĥ_l|² exp(i ω_l t_k); for k = 1 … K.

    R has no frequency above max k_l: its peak is found on a grid of 4 max k_l cells (rounded up to 16), and by a
    parabola through the highest one and its neighbours.

    The frame is without padding. Returns depth, bins, less than a cell outside
    [0, T], and intensity times exposure, float32 [rows, K, cols].
    """
    z, found = frame.matched, []
    for _ in range(surfaces):
        depth, value = _peak(z, frame)
        found.append((depth, value / frame.total_energy))
        z = z - torch.cat([frame.energy[:, None] * found[-1][1][:, None] * wave for wave in waves(frame, depth)], dim=1)
    return tuple(torch.stack(values, dim=1) for values in zip(*found))


def _peak(z, frame):
    """Where the responses R(z, t) of pixels are highest, bins, and how high; [..., cols] each of z [..., 2m, cols]."""
    cells, sketches = len(frame.filters), z.movedim(-2, 0)
    response = (frame.filters @ sketches.flatten(1)).unflatten(1, sketches.shape[1:])
    peak, top = response.max(dim=0, keepdim=True)
    before, after = (response.gather(0, (top + step) % cells) for step in (-1, 1))
    bend = before - 2 * peak + after
    shift = torch.where(bend < 0, (before - after) / 2 / bend, 0)
    height = peak - (before - after) / 4 * shift
    return ((top + shift) * (frame.num_bins / cells))[0], height[0]


@fused
def residual(frame, state, terms, layer):
    """z_l − Σ_{k ≠ layer} (v_k / E)₊ |ĥ_l|² exp(i ω_l t_k): each surface as strong as its own pixel shows it.

    With the intensities of pools too much would be taken from some pixels, and the filter would respond half a
    period away.
    """
    signal = terms[:, :, maps.VALUE].clamp(min=0) / frame.total_energy
    others = torch.arange(state.shape[1], device=state.device)[:, None] != layer
    signal = (signal * others)[:, :, None] * frame.energy[:, None]
    return frame.matched - torch.cat([(signal * wave).sum(dim=1) for wave in waves(frame, state[:, :, maps.DEPTH])], 1)


def no_surfaces(frame, surfaces):
    """A state without any surface, for a frame's iterations."""
    return frame.matched.new_zeros(state_shape(*frame.shape, surfaces))


class Pools(NamedTuple):
    """What cells' windows add up to: sketches [rows, 2m, cols], and photons and exposure."""

    z: torch.Tensor
    counts: torch.Tensor
    exposure: torch.Tensor
    share: float                # q: 1/2 of a Gaussian window, 1 of a pixel


@fused
def search(frame, matched, state, layer, sigma, step, enough, carried=None, confirmed=0.0, slanted=False):
    """Give open pixels the surface that one scale shows: score = p / √N · ρ(S E / p) / c(t) > `enough`.

    Open is a used pixel without surface `layer`, but with the one before. Of the open pixels around each cell
    z̄ = Σ w z, N = Σ w² n and G = Σ w g are pooled, as by `blur_cells` with σ / step; with other pixels, surfaces would
    grow over those that see background alone. t and S are `match` of z̄. q = Σ w² / Σ w is 1 for one pixel, 1/2 for
    a Gaussian; p = N / q. Since S E ≤ Σ_l |z̄_l|, most cells that are not sure need no filter.

    If `slanted`, windows along planes follow that rise by δ / σ to the right, to the left, down and up: the sums of
    cells times exp(−i ω_l slope · position) are pooled, which adds up such a plane as a flat window adds up one of
    slope 0, and slope · position is added to t. `enough` is START_SCORE then. The same pixels are pooled; one that
    has found a surface below SURE_SCORE takes another with a higher score.

    The cell's open pixels get depth t, the slopes, intensity S / G and standard deviation
    √(q (S M₁ + (p − S)₊ M₀)) / (S C), at most T.

    Args:
        matched: float32 [rows', 2m, cols'], z: of the frame, or of `residual`.
        state: changed in place.
        layer: index of the surface that is searched for.
        sigma: σ of the window, pixels; 0: every pixel on its own.
        step: pixels along the side of a cell.
        enough: standard deviations.
        carried: the state of the frame before. Its depth and slopes stay, measured anew at that depth, where the
            score there is above `confirmed`, and the new one is not better by VOTE: (score² − score_old²) / 2.
        confirmed: standard deviations.
        slanted: for a sigma above 0.
    """
    view = crop(state, *frame.shape)
    point, used = view[:, layer], crop(frame.exposure, *frame.shape) > 0
    is_open = used & (point[:, INTENSITY] == 0)
    if layer > 0:
        is_open = is_open & (view[:, layer - 1, INTENSITY] > 0)
    pixels = [crop(values, *frame.shape) for values in (matched, frame.counts, frame.exposure)]
    pools, cells = _pooled(*pixels, is_open, sigma, step)
    new = _in_pixels(frame, step, _shown(frame, *_peak(pools.z, frame), (0.0, 0.0), pools))
    found = _better(point, new, is_open, enough)
    if carried is not None:
        old = crop(carried, *frame.shape)[:, layer]
        found = _kept(frame, found, new[:, SCORE], old, step, is_open, pools, confirmed)
    if slanted:
        doubtful = is_open & ((found[:, INTENSITY] == 0) | (found[:, SCORE] < SURE_SCORE))
        plane = _in_pixels(frame, step, _slanted(frame, cells, pools, sigma, step))
        found = _better(found, plane, doubtful, START_SCORE)
    point[:] = found


def _pooled(matched, counts, exposure, is_open, sigma, step) -> tuple:
    """The windows of a search, and the cells that they add up."""
    z, photons = matched, torch.stack([counts, exposure], 1)
    if sigma == 0:
        return Pools(z, photons[:, 0], photons[:, 1], 1.0), z
    cells, photons = (cell_sums(values * is_open[:, None], step) for values in (z, photons))
    weights = gaussian(sigma / step, z)
    photons = window_sums(photons, torch.stack([weights**2, weights])[:, None])
    return Pools(window_sums(cells, weights), photons[:, 0], photons[:, 1], 0.5), cells


def _slanted(frame, cells, pools, sigma, step):
    """What the best of the planes that rise to the right, to the left, down and up shows: as `_shown`."""
    rise = frame.resolution_bins / sigma
    row, col = (torch.arange(size, device=cells.device) for size in (cells.shape[0], cells.shape[2]))
    right, down = torch.broadcast_tensors(col, row[:, None])
    (cosine, sine), (re, im) = waves(frame, step * rise * torch.stack([right, -right, down, -down])), cells.chunk(2, 1)
    flat = torch.cat([re * cosine + im * sine, im * cosine - re * sine], dim=2)
    re, im = window_sums(flat, gaussian(sigma / step, cells)).chunk(2, dim=2)
    z = torch.cat([re * cosine - im * sine, im * cosine + re * sine], dim=2)
    which = torch.arange(4, device=cells.device)[:, None, None]
    slopes = [rise * ((which == first).to(z.dtype) - (which == first + 1).to(z.dtype)) for first in (0, 2)]
    shown = _shown(frame, *_peak(z, frame), slopes, pools)
    best = shown[:, :, SCORE].argmax(dim=0)
    return shown.gather(0, best[None, :, None].expand(1, *shown.shape[1:]))[0]


def _shown(frame, depth, signal, slopes, pools):
    """The fields up to SCORE, [..., rows, SCORE + 1, cols], of surfaces of pools, by the signal that responds."""
    depth, signal = depth % frame.num_bins, signal / frame.total_energy
    photons, light = pools.counts / pools.share, pools.exposure.clamp(min=EPSILON)
    score = evidence(signal * frame.total_energy, photons, pools.counts, frame) / noise_ratio(frame, depth)
    slopes = (0 * depth + slope for slope in slopes)        # in the same launch; a constant would take one more
    return torch.stack([depth, *slopes, signal / light, _std(frame, signal, photons, pools.share), score], dim=-2)


def _of_cells(frame, step, values):
    """The values of its cell, [rows, …, cols], for each pixel."""
    row, col = (torch.arange(size, device=values.device) // step for size in frame.shape)
    return values[row][..., col]


def _in_pixels(frame, step, shown):
    """What cells show in each of their pixels, by their slopes: [rows, SCORE + 1, cols]."""
    row, col = (torch.arange(size, device=shown.device) for size in frame.shape)
    depth, *more = _of_cells(frame, step, shown).unbind(1)
    right, down = (place % step - (step - 1) / 2 for place in (col, row[:, None]))
    return torch.stack([(depth + more[0] * right + more[1] * down) % frame.num_bins, *more], dim=1)


def _better(point, new, wanted, enough):
    """The points [rows, FIELDS, cols], or the new ones in wanted pixels where these are better."""
    known = torch.where(point[:, INTENSITY] > 0, point[:, SCORE], -math.inf)
    better = wanted & (new[:, SCORE] > known) & (new[:, SCORE] > enough)
    return _where(better, new, point)


def _kept(frame, found, score, old, step, wanted, pools, confirmed):
    """The points found, or the last frame's where this one's photons confirm them, and new ones score no better."""
    pools = Pools(*(_of_cells(frame, step, values) for values in pools[:-1]), pools.share)
    (cosine, sine), (re, im) = waves(frame, old[:, maps.DEPTH]), pools.z.chunk(2, dim=1)
    slopes = old[:, maps.SLOPE_COL], old[:, maps.SLOPE_ROW]
    kept = _shown(frame, old[:, maps.DEPTH], (re * cosine + im * sine).sum(dim=1), slopes, pools)
    stays = wanted & (old[:, INTENSITY] > 0) & (kept[:, SCORE] > confirmed) & (
        score**2 - kept[:, SCORE]**2 < 2 * VOTE)
    return _where(stays, kept, found)


def _where(condition, new, point):
    """The points, with new fields up to SCORE where the condition holds."""
    return torch.cat([torch.where(condition[:, None], new, point[:, :RESIDUAL]), point[:, RESIDUAL:]], dim=1)


def _std(frame, signal, photons, share):
    """Standard deviation of a depth found in a pool, bins."""
    signal = signal.clamp(min=EPSILON)
    background = (photons - signal).clamp(min=0)
    spread = share * (signal * frame.moments[0] + background * frame.moments[1])
    return (torch.sqrt(spread) / (signal * frame.curvature)).clamp(max=frame.num_bins)
