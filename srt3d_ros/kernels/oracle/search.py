"""The start: `prepare`, `match`, `search` and `residual`."""

import math
from functools import partial
from types import SimpleNamespace

import numpy as np
import torch

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import EPSILON, START_SCORE, SURE_SCORE, VOTE
from srt3d_ros.kernels.maps import crop, state_shape, window_weights
from srt3d_ros.kernels.oracle.arithmetic import as_complex, as_map, noise_ratio, pad, waves
from srt3d_ros.kernels.oracle.blur import blur, blur_cells
from srt3d_ros.kernels.oracle.likelihood import evidence
from srt3d_ros.kernels.oracle.windows import by_rows

RESPONSES = 3           # arrays of responses to the matched filter that are held at once, about
NUMBERS = 16            # that `residual` holds for each frequency of a point, about


def prepare(sums, photons, equaliser, used, taken=None, shown=None):
    """z_l = equaliser_l · sums_l − taken · shown_l, and used · n: a frame's `matched` and `counts`, padded with 0.

    Args:
        sums: complex64 [rows, cols, m], Σ_p exp(i ω_l x_p).
        photons: float32 [rows, cols], n.
        equaliser: complex64 [rows or 1, cols or 1, m], conj(ĥ_l) with the pixel's delay; 0 masks it.
        used: float32 [rows, cols], 1, or 0 in masked pixels.
        taken: float32 [rows, cols], background photons to subtract; 0 in masked pixels. None for none.
        shown: complex64 [rows or 1, cols or 1, m], what each of them adds to z_l on average.
    """
    z = sums * equaliser
    if taken is not None:
        z = z - taken[..., None] * shown
    return pad(as_map(z.transpose(1, 2))), pad(photons * used)


def match(frame, surfaces):
    """t_k = arg max_t R(z, t), r_k = R(z, t_k) / E, then z_l −= r_k |ĥ_l|² exp(i ω_l t_k); for k = 1 … K.

    R has no frequency above max k_l: its peak is found on a grid of 4 max k_l cells (rounded up to 16), and by a
    parabola through the highest one and its neighbours.

    The frame is without padding. Returns depth, bins, less than a cell outside
    [0, T], and intensity times exposure, float32 [rows, K, cols].
    """
    z, found = as_complex(frame.matched), []
    for _ in range(surfaces):
        depth, value = _peak(z, frame)
        found.append((depth, value / frame.total_energy))
        z = z - frame.energy[:, None] * found[-1][1][:, None] * waves(frame, depth)
    return tuple(torch.stack(values, dim=1) for values in zip(*found))


def _peak(z, frame):
    """Where the responses R(z, t) of pixels are highest, bins, and how high; [rows, cols] each."""
    cells = 16 * math.ceil(frame.highest / 4)
    place = torch.arange(cells, device=z.device, dtype=torch.float64) / cells
    angle = 2 * math.pi * place[:, None] * (frame.bin_frequencies.double() * frame.num_bins).round()
    filters = torch.cat([torch.cos(angle), torch.sin(angle)], dim=1).to(z.real.dtype)         # [cells, 2m]
    matched = as_map(z)
    top, height = by_rows(partial(_highest, filters), RESPONSES * cells * matched[0, 0].nbytes, matched, margin=0)
    return top * (frame.num_bins / cells), height


def _highest(filters, matched):
    """Between which cells the filters respond most, and how much, by the parabola through three of them."""
    response = filters @ matched                                                                # [rows, cells, cols]
    peak, top = response.max(dim=1, keepdim=True)
    before, after = (response.gather(1, (top + step) % len(filters)) for step in (-1, 1))
    bend = before - 2 * peak + after
    shift = torch.where(bend < 0, (before - after) / 2 / bend, 0)
    return (top + shift)[:, 0], (peak - (before - after) / 4 * shift)[:, 0]


def residual(frame, state, terms, layer):
    """z_l − Σ_{k ≠ layer} (v_k / E)₊ |ĥ_l|² exp(i ω_l t_k): each surface as strong as its own pixel shows it.

    With the intensities of pools too much would be taken from some pixels, and the filter would respond half a
    period away.
    """
    numbers = NUMBERS * len(frame.energy) * state.shape[1]
    return by_rows(partial(_residual, layer), numbers * state[0, 0, 0].nbytes, frame, state, terms, margin=0)[0]


def _residual(layer, frame, state, terms):
    signal = terms[:, :, maps.VALUE].clamp(min=0) / frame.total_energy
    signal[:, layer].zero_()
    shown = (signal[:, :, None] * waves(frame, state[:, :, maps.DEPTH])).sum(dim=1)
    return (frame.matched - as_map(frame.energy[:, None] * shown),)


def no_surfaces(frame, surfaces):
    """A state without any surface, for a frame's iterations."""
    return frame.matched.new_zeros(state_shape(*frame.shape, surfaces))


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
    is_open = (crop(frame.exposure, *frame.shape) > 0) & (view[:, layer, maps.INTENSITY] == 0)
    if layer > 0:
        is_open &= view[:, layer - 1, maps.INTENSITY] > 0
    pools = (frame, is_open, sigma, step)
    _take(frame, state, layer, step, is_open, _pooled(matched, (0.0, 0.0), *pools), enough, carried, confirmed)
    rise = frame.resolution_bins / sigma if slanted else 0.0
    point = view[:, layer]
    doubtful = is_open & ((point[:, maps.INTENSITY] == 0) | (point[:, maps.SCORE] < SURE_SCORE))
    for slope in ((rise, 0.0), (-rise, 0.0), (0.0, rise), (0.0, -rise)) if slanted else ():
        _take(frame, state, layer, step, doubtful, _pooled(matched, slope, *pools), START_SCORE)


def _pooled(matched, slope, frame, is_open, sigma, step) -> SimpleNamespace:
    """What the cells' windows add up to along planes of this slope, and what matches that best."""
    rows, cols = frame.shape
    counts, exposure = (crop(values, rows, cols)[:, None] for values in (frame.counts, frame.exposure))
    pools, share = [crop(matched, rows, cols), counts, exposure], 1.0
    if sigma > 0:
        weights, one, share = window_weights(sigma / step), np.ones(1, np.float32), 0.5
        pools = [blur_cells(values * is_open[:, None], one, step) for values in pools]
        row, col = (torch.arange(size, device=matched.device) for size in (len(pools[0]), pools[0].shape[2]))
        plane = waves(frame, step * (slope[0] * col + slope[1] * row[:, None]))
        flattened = blur(as_map(as_complex(pools[0]) * plane.conj()), weights)
        pools = [as_map(as_complex(flattened) * plane), blur(pools[1], weights**2), blur(pools[2], weights)]
    z = as_complex(pools[0])
    depth, signal = _peak(z, frame)
    return SimpleNamespace(z=z, depth=depth % frame.num_bins, signal=signal / frame.total_energy, share=share,
                           slope=slope, counts=pools[1][:, 0], exposure=pools[2][:, 0])


def _take(frame, state, layer, step, wanted, pools, enough, carried=None, confirmed=0.0) -> None:
    """Write what the pools show into the wanted pixels of their cells."""
    rows, cols = frame.shape
    view = crop(state, rows, cols)
    point = view[:, layer]
    row, col = (torch.arange(pixels, device=state.device) for pixels in (rows, cols))
    cell = row[:, None] // step, col // step
    middle, signal, photons = (values[cell] for values in (pools.depth, pools.signal, pools.counts))
    light = pools.exposure[cell].clamp(min=EPSILON)

    def measured(t, at, slopes, signal):
        """The fields up to SCORE of surfaces at depths t with this signal in the pixels' cells, by the noise `at`."""
        score = evidence(signal * frame.total_energy, photons / pools.share, photons, frame) / noise_ratio(frame, at)
        return torch.stack([t, *slopes, signal / light, _std(frame, signal, photons, pools.share), score], dim=1)

    right, down = (place % step - (step - 1) / 2 for place in (col, row[:, None]))
    there = (middle + pools.slope[0] * right + pools.slope[1] * down) % frame.num_bins
    new = measured(there, middle, [torch.full_like(middle, part) for part in pools.slope], signal)
    least = torch.where(point[:, maps.INTENSITY] > 0, point[:, maps.SCORE], -math.inf).clamp(min=enough)
    better = wanted & (new[:, maps.SCORE] > least)
    if carried is not None:
        old = crop(carried, rows, cols)[:, layer]
        along = pools.z[cell[0][:, 0]][:, :, cell[1]] * waves(frame, old[:, maps.DEPTH]).conj()
        kept = measured(old[:, maps.DEPTH], old[:, maps.DEPTH], (old[:, maps.SLOPE_COL], old[:, maps.SLOPE_ROW]),
                        along.real.sum(dim=1) / frame.total_energy)
        stays = wanted & (old[:, maps.INTENSITY] > 0) & (kept[:, maps.SCORE] > confirmed) & (
            new[:, maps.SCORE]**2 - kept[:, maps.SCORE]**2 < 2 * VOTE)
        new, better = torch.where(stays[:, None], kept, new), better | stays
    point[:, :maps.RESIDUAL] = torch.where(better[:, None], new, point[:, :maps.RESIDUAL])


def _std(frame, signal, counts, share):
    """Standard deviation of a depth found in a pool, bins."""
    signal = signal.clamp(min=EPSILON)
    background = (counts / share - signal).clamp(min=0)
    spread = share * (signal * frame.moments[0] + background * frame.moments[1])
    return (torch.sqrt(spread) / (signal * frame.curvature)).clamp(max=frame.num_bins)
