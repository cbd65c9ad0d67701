"""The matched filter on a sketch, R(z, t) = Σ_l Re(z_l exp(−i ω_l t)), and where it peaks: `match`.

t_k = arg max_t R(z, t), r_k = R(z, t_k) / E, then z_l −= r_k |ĥ_l|² exp(i ω_l t_k), for k = 1 … K. R is computed at
cells, equal parts of the period, of LANES pixels at a time; a parabola through the highest cell and its neighbours
gives the peak. A pixel's z has its real parts before the imaginary ones, each in the order of `Steering`.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import get_num_threads, get_thread_id, int64

from srt3d_ros.kernels.constants import EPSILON
from srt3d_ros.kernels.cpu.compiling import each, floats3d, inline, line
from srt3d_ros.kernels.cpu.method.frame import Frame, without
from srt3d_ros.kernels.cpu.spans import ALL
from srt3d_ros.kernels.cpu.vectors import fma, full, lane_numbers, to_ints, where
from srt3d_ros.kernels.maps import LANES


class Steering(NamedTuple):
    """Cosines and sines of ω_l t at the cells of the first quarter of the period."""

    waves: floats3d             # [pairs of cells, m, 4]: cosines at both cells, sines at both
    order: int64[::1]           # [m], which l comes first: those with an even k_l before those with an odd one
    even: int64                 # how many k_l are even
    cells: int64                # of the whole period


@lru_cache
def steering(frequencies: tuple) -> Steering:
    """Steering for the frequencies k_l."""
    cells, k = 16 * math.ceil(max(frequencies) / 4), np.array(frequencies)
    order = np.argsort(k % 2, kind="stable")
    turns = np.arange(cells // 4 + 2).reshape(-1, 1, 2) * k[order, None] / cells
    waves = np.concatenate([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)], axis=2)
    return Steering(waves.astype(np.float32), order, int((k % 2 == 0).sum()), cells)


@inline
def _sums(z, waves, pair, first, end):
    """Σ Re z_l cos ω_l t and Σ Im z_l sin ω_l t at both cells of a pair; of one cell at a time it takes longer."""
    m = waves.shape[1]
    cos, sin, next_cos, next_sin = full(0.0), full(0.0), full(0.0), full(0.0)
    for n in range(first, end):
        re, im = z[n, ALL], z[m + n, ALL]
        cos, next_cos = fma(re, waves[pair, n, 0], cos), fma(re, waves[pair, n, 1], next_cos)
        sin, next_sin = fma(im, waves[pair, n, 2], sin), fma(im, waves[pair, n, 3], next_sin)
    return cos, sin, next_cos, next_sin


@inline
def _store_images(response, cell, half, even, odd):
    """Write R at a cell of the first quarter and its images at T/2 − t, T/2 + t and T − t.

    There cos ω_l t and sin ω_l t keep their size and change their signs by whether k_l is even or odd.
    """
    (cos, sin), (odd_cos, odd_sin) = even, odd
    response[cell, ALL] = cos + sin + odd_cos + odd_sin
    response[half - cell, ALL] = cos - sin - odd_cos + odd_sin
    response[half + cell, ALL] = cos + sin - odd_cos - odd_sin
    response[2 * half - cell, ALL] = cos - sin + odd_cos - odd_sin


@line
def peaks(z, steering, period, response):
    """Places (bins) and heights of the highest peaks of R(z, t), of z [2m, LANES].

    `response` [cells + 1, LANES] is scratch; its last cell is the first one again.
    """
    waves, cells = steering.waves, np.float32(steering.cells)
    for pair in range(len(waves)):
        a, b, c, d = _sums(z, waves, pair, 0, steering.even)
        e, f, g, h = _sums(z, waves, pair, steering.even, waves.shape[1])
        _store_images(response, 2 * pair, steering.cells // 2, (a, b), (e, f))
        _store_images(response, 2 * pair + 1, steering.cells // 2, (c, d), (g, h))
    height, top = response[0, ALL], full(0.0)
    for cell in range(1, steering.cells):
        here = response[cell, ALL]
        top, height = where(here > height, cell, top), max(here, height)
    before = response[to_ints(where(top > 0, top, cells) - 1, cells), lane_numbers()]
    after = response[to_ints(top + 1, cells), lane_numbers()]
    bend = before - 2 * height + after
    shift = where(bend < 0, 0.5 * (before - after) / bend, 0)
    return (top + shift) * (period / cells), height - 0.25 * (before - after) * shift


@each
def _match(i, j, frame: Frame, steering: Steering, scratch: floats3d, depth: floats3d, intensity: floats3d):
    m, own = len(steering.order), scratch[get_thread_id()]
    z, response = own[:2 * m], own[2 * m:]
    for n in range(m):
        z[n, ALL], z[m + n, ALL] = frame.matched[i, steering.order[n], j], frame.matched[i, m + steering.order[n], j]
    for k in range(depth.shape[1]):
        place, height = peaks(z, steering, frame.period, response)
        signal = height / frame.total_energy
        depth[i, k, j], intensity[i, k, j] = place, signal
        for n in range(m):
            z[n, ALL], z[m + n, ALL] = without(z[n, ALL], z[m + n, ALL], steering.order[n], signal, place, frame)


def match(frame, surfaces):
    rows, _, cols = frame.matched.shape
    depth, intensity = (np.zeros((rows, surfaces, cols), np.float32) for _ in range(2))
    filters = steering(tuple(np.rint(frame.bin_frequencies * np.float64(frame.num_bins))))
    scratch = np.empty((get_num_threads(), 2 * len(filters.order) + filters.cells + 1, LANES), np.float32)
    _match(frame, filters, scratch, depth, intensity)
    light = frame.exposure[:, None]
    return depth, intensity.clip(min=0) / light.clip(min=EPSILON) * (light > 0)
