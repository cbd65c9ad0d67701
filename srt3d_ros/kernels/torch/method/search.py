"""The start: `search`."""

from typing import NamedTuple

import torch

from srt3d_ros.kernels.constants import EPSILON, SEEN_SCORE, SLANT, SLANTED_SCORE, STEEPER, SURE_SCORE
from srt3d_ros.kernels.maps import INTENSITY, RESIDUAL, SCORE, state_shape
from srt3d_ros.kernels.torch.arithmetic import noise_ratio, turned, waves
from srt3d_ros.kernels.torch.fusing import fused
from srt3d_ros.kernels.torch.method.likelihood import evidence
from srt3d_ros.kernels.torch.method.match import peaks
from srt3d_ros.kernels.torch.method.windows import across_sums, cell_sums, down_sums, gaussian, inner, window_sums


def no_surfaces(frame, surfaces):
    """A state without any surface, for a frame's iterations."""
    return frame.matched.new_zeros(state_shape(*frame.shape, surfaces))


class Pools(NamedTuple):
    """Windows of cells: sums of sketches [rows, 2m, cols], of photons and of exposure."""

    z: torch.Tensor
    counts: torch.Tensor
    exposure: torch.Tensor
    share: float                # q: 1/2 of a Gaussian window, 1 of a pixel


def search(frame, matched, state, layer, sigma, step, enough, slanted=False):
    """Give open pixels the surface that one scale shows: score = p / √N · ρ(S E / p) / c(t) > `enough`.

    A pixel is open if it has `layer` surfaces and could get one more. The open pixels around each cell are pooled:
    z̄ = Σ w z, N = Σ w² n and G = Σ w g, with σ / step. Other pixels do not count: otherwise surfaces
    spread into background-only pixels. t and S are `match` of z̄. q = Σ w² / Σ w is 1 for one pixel, 1/2 for a Gaussian;
    p = N / q. Since S E ≤ Σ_l |z̄_l|, most cells that are not sure need no filter.

    If `slanted`, windows along planes follow that rise or fall by SLANT · δ / σ to the right, downwards, or both: the
    sums of cells times exp(−i ω_l slope · position) are pooled, which adds up such a plane as a flat window adds up one
    of slope 0, and slope · position is added to t. The best replaces what the flat window shows in the same pixels, if
    that has a score from SEEN_SCORE to SURE_SCORE; its own must be above SLANTED_SCORE and √STEEPER times as high.

    The cell's open pixels get depth t, the slopes, intensity S / G and standard deviation
    √(q (S M₁ + (p − S)₊ M₀)) / (S C), at most T.
    """
    found = _search_flat(frame, matched, state, layer, sigma, step, enough, slanted)
    if slanted:
        cells, pools, is_open, flat = found
        lines, rises = _pool_down(frame, cells, sigma, step)
        planes = [_search_across(frame, line, rise, rises, pools, sigma, step) for line, rise in zip(lines, rises)]
        _take_planes(frame, state, layer, step, is_open, flat, *planes)


@fused
def _search_flat(frame, matched, state, layer, sigma, step, enough, slanted):
    """Search with flat windows; returns cells, pools, open pixels and scores for the slanted ones."""
    view = inner(frame, state)
    point, z, counts, exposure = (view[:, layer], *(inner(frame, values) for values in (
        matched, frame.counts, frame.exposure)))
    is_open = (exposure > 0) & (point[:, INTENSITY] == 0)
    if layer > 0:
        is_open = is_open & (view[:, layer - 1, INTENSITY] > 0)
    pools, cells = _pooled(z, counts, exposure, is_open, sigma, step)
    shown = _shown(frame, *peaks(pools.z, frame), (0.0, 0.0), pools)
    new = _in_pixels(frame, step, shown)
    _give(point, is_open & (new[:, SCORE] > enough), new)
    return (cells, pools, is_open, shown[:, SCORE]) if slanted else None


def _pooled(matched, counts, exposure, is_open, sigma, step) -> tuple:
    """The windows of a search, and the cells that they sum."""
    z, photons = matched, torch.stack([counts, exposure], 1)
    if sigma == 0:
        return Pools(z, photons[:, 0], photons[:, 1], 1.0), z
    cells, photons = (cell_sums(values * is_open[:, None], step) for values in (z, photons))
    weights = gaussian(sigma / step, z)
    photons = window_sums(photons, torch.stack([weights**2, weights])[:, None])
    return Pools(window_sums(cells, weights), photons[:, 0], photons[:, 1], 0.5), cells


def _turned(cells, wave):
    """Sketches [..., 2m, cols] times exp(−iφ), of cos φ and sin φ [..., m, cols]."""
    return torch.cat(turned(cells.chunk(2, -2), wave), dim=-2)


@fused
def _pool_down(frame, cells, sigma, step):
    """Windows of rows along lines that fall, stay and rise downwards: [3, rows, 2m, cols]; and by how much, bins."""
    rises = SLANT * frame.resolution_bins / sigma * torch.arange(-1, 2, device=cells.device, dtype=cells.dtype)
    row = torch.arange(len(cells), device=cells.device)[:, None]
    cosine, sine = waves(frame, step * rises[:, None, None] * row)
    lines = down_sums(_turned(cells, (cosine, sine)), gaussian(sigma / step, cells))
    return _turned(lines, (cosine, -sine)), rises


@fused
def _search_across(frame, line, rise, rises, pools, sigma, step):
    """The best of three planes that rise alike downwards, and fall, stay or rise to the right."""
    col = torch.arange(line.shape[-1], device=line.device)
    cosine, sine = waves(frame, step * rises[:, None, None] * col)
    z = across_sums(_turned(line, (cosine, sine)), gaussian(sigma / step, line))
    shown = _shown(frame, *peaks(_turned(z, (cosine, -sine)), frame), (rises[:, None, None], rise), pools)
    return _best_of(shown)


def _best_of(shown):
    """The surface with the highest score, of [planes, rows, SCORE + 1, cols]."""
    best = shown[:, :, SCORE].argmax(dim=0)
    return shown.gather(0, best[None, :, None].expand(1, *shown.shape[1:]))[0]


@fused
def _take_planes(frame, state, layer, step, is_open, flat, *planes):
    """Give doubtful pixels the best plane, if its score exceeds the flat window's by enough."""
    point = inner(frame, state)[:, layer]
    plane, flat = _best_of(torch.stack(planes)), flat[:, None]
    least = (STEEPER**0.5 * flat).clamp(min=SLANTED_SCORE)
    enough = _of_cells(frame, step, (flat > SEEN_SCORE) & (plane[:, SCORE:] > least))[:, 0]
    doubtful = is_open & ((point[:, INTENSITY] == 0) | (point[:, SCORE] < SURE_SCORE))
    _give(point, doubtful & enough, _in_pixels(frame, step, plane))


def _shown(frame, depth, signal, slopes, pools):
    """The fields up to SCORE, [..., rows, SCORE + 1, cols], of surfaces of pools, by the signal that responds."""
    depth, signal = depth % frame.num_bins, signal / frame.total_energy
    photons, light = pools.counts / pools.share, pools.exposure.clamp(min=EPSILON)
    score = evidence(signal * frame.total_energy, photons, pools.counts, frame) / noise_ratio(frame, depth)
    slopes = (0 * depth + slope for slope in slopes)        # a constant would take another launch
    return torch.stack([depth, *slopes, signal / light, _std(frame, signal, photons, pools.share), score], dim=-2)


def _of_cells(frame, step, values):
    """The values of its cell, [rows, …, cols], for each pixel."""
    row, col = (torch.arange(size, device=values.device) // step for size in frame.shape)
    return values[row][..., col]


def _in_pixels(frame, step, shown):
    """The surfaces of cells at each of their pixels, by their slopes: [rows, SCORE + 1, cols]."""
    row, col = (torch.arange(size, device=shown.device) for size in frame.shape)
    depth, *more = _of_cells(frame, step, shown).unbind(1)
    right, down = (place % step - (step - 1) / 2 for place in (col, row[:, None]))
    return torch.stack([(depth + more[0] * right + more[1] * down) % frame.num_bins, *more], dim=1)


def _give(point, condition, new) -> None:
    """Replace the fields up to SCORE where the condition holds."""
    point[:, :RESIDUAL] = torch.where(condition[:, None], new, point[:, :RESIDUAL])


def _std(frame, signal, photons, share):
    """Standard deviation of the depth of a pool, bins."""
    signal = signal.clamp(min=EPSILON)
    background = (photons - signal).clamp(min=0)
    spread = share * (signal * frame.moments[0] + background * frame.moments[1])
    return (torch.sqrt(spread) / (signal * frame.curvature)).clamp(max=frame.num_bins)
