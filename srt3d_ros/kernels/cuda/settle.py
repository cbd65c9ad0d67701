"""The end of a reconstruction: which points the photons speak for, how bright and how sure each is."""

import triton
import triton.language as tl

from srt3d_ros.core import layout
from srt3d_ros.core.start import window_weights
from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cuda.arithmetic import TINY
from srt3d_ros.kernels.cuda.blur import blur
from srt3d_ros.kernels.cuda.intensity import own_intensity
from srt3d_ros.kernels.cuda.layout import BLOCK, DEPTH, FIELDS, INTENSITY, MARGIN, SCORE, STD
from srt3d_ros.kernels.cuda.relief import relief
from srt3d_ros.kernels.cuda.scratch import borrow, constant

DIMMEST, FAINTEST, LEAST_SHARE = (tl.constexpr(getattr(constants, name)) for name in (
    "DIMMEST", "FAINTEST", "LEAST_SHARE"))
SHARE_WEIGHTS = window_weights(constants.SHARE_WINDOW, 1)


@triton.jit
def _excess(noise, exposure, moments, total, state, own, out, cols, wide, SURFACES: tl.constexpr):
    i, j = tl.program_id(1), tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    inside, pixel = j < cols, (i + MARGIN) * wide + j + MARGIN
    light = tl.maximum(tl.load(exposure + pixel, mask=inside, other=0.0), DIMMEST)
    photons = tl.load(noise + pixel, mask=inside, other=0.0)
    for k in tl.static_range(SURFACES):
        layer = (i + MARGIN) * SURFACES + k
        pooled = tl.load(state + (layer * FIELDS + INTENSITY) * wide + j + MARGIN, mask=inside, other=0.0)
        excess = tl.load(own + layer * wide + j + MARGIN, mask=inside, other=0.0) - pooled
        signal = pooled * light
        spread = signal * tl.load(moments) + tl.maximum(photons - signal, 0.0) * tl.load(moments + 1)
        variance = spread / (total * light * (total * light))
        into = out + (i * 2 * SURFACES + k) * cols + j
        tl.store(into, tl.where(pooled > 0.0, excess * excess, 0.0), mask=inside)
        tl.store(into + SURFACES * cols, tl.where(pooled > 0.0, variance, 0.0), mask=inside)


@triton.jit
def _settle(photons, exposure, clutter, enough, period, state, own, around, bent, intensity, std, background, cols,
            wide, SURFACES: tl.constexpr, LAYERS: tl.constexpr, BINS: tl.constexpr):
    """All surfaces of a pixel together: LAYERS is K or the next power of two; BINS as of `_decide`."""
    i, j, k = tl.program_id(1), tl.program_id(0) * BLOCK + tl.arange(0, BLOCK), tl.arange(0, LAYERS)[:, None]
    inside = (j < cols)[None, :] & (k < SURFACES)
    padded = ((i + MARGIN) * SURFACES + k) * wide + (j + MARGIN)[None, :]
    point = state + ((i + MARGIN) * SURFACES + k) * FIELDS * wide + (j + MARGIN)[None, :]
    pooled = tl.load(point + INTENSITY * wide, mask=inside, other=0.0)
    score = tl.load(point + SCORE * wide, mask=inside, other=0.0)
    if BINS > 0:
        here = tl.floor(tl.load(point + DEPTH * wide, mask=inside, other=0.0) + 0.5).to(tl.int32) % BINS
        score = score / tl.load(clutter + here)
    squares = around + (i * 2 * SURFACES + k) * cols + j[None, :]
    excess = tl.load(squares, mask=inside, other=0.0)
    differ = tl.maximum(excess - tl.load(squares + SURFACES * cols, mask=inside, other=0.0), 0.0)
    value = pooled + (tl.load(own + padded, mask=inside, other=0.0) - pooled) * (differ / tl.maximum(excess, TINY))
    kept = (score > enough) & (pooled > 0.0)
    value = tl.where(kept, tl.maximum(value, pooled * LEAST_SHARE), 0.0)
    value = tl.where(value < tl.max(value, axis=0)[None, :] * FAINTEST, 0.0, value)
    sigma, off = tl.load(point + STD * wide, mask=inside, other=0.0), tl.load(bent + padded, mask=inside, other=0.0)
    sigma = tl.minimum(tl.maximum(tl.sqrt(sigma * sigma + off * off), DIMMEST), period)
    into = (i * SURFACES + k) * cols + j[None, :]
    tl.store(intensity + into, value, mask=inside)
    tl.store(std + into, sigma, mask=inside)
    seen = tl.sum(value, axis=0) * tl.load(exposure + (i + MARGIN) * wide + j + MARGIN, mask=j < cols, other=0.0)
    count = tl.load(photons + i * cols + j, mask=j < cols, other=0).to(tl.float32)
    tl.store(background + i * cols + j, tl.maximum(count - seen, 0.0), mask=j < cols)


def settle(data, photons, state, enough, window, radius, gate, scratch=None):
    """The points that the photons speak for: how bright and how sure each is; and the background.

    How bright is told in kernels/cpu/settle.py.

    Args:
        data: the frame, padded.
        photons: uint32 [rows, cols], all that the frame's pixels saw.
        state: float32 [rows', K, FIELDS, cols'].
        enough: score above which a point is kept, standard deviations.
        window, radius, gate: of `relief`, which counts as uncertainty.
        scratch: memory to use.

    Returns:
        intensity (0: no point) and std (bins), float32 [rows, K, cols], and background photons, float32 [rows, cols].
    """
    (rows, cols), surfaces, wide = data.shape, state.shape[1], state.shape[3]
    maps, grid = (state.shape[0], surfaces, wide), (triton.cdiv(cols, layout.BLOCK), rows)
    own = own_intensity(data, state, borrow(scratch, "own", maps))
    bent = relief(state, window, radius, gate, data.num_bins, borrow(scratch, "relief", maps))
    excess, around = (borrow(scratch, name, (rows, 2 * surfaces, cols)) for name in ("excess", "around"))
    _excess[grid](data.noise, data.exposure, data.intensity_moments, data.total_energy, state, own, excess, cols, wide,
                  SURFACES=surfaces, num_warps=1)
    blur(excess, constant(SHARE_WEIGHTS), 1, around)
    intensity, std = (borrow(scratch, name, (rows, surfaces, cols)) for name in ("intensity", "std"))
    background = state.new_empty(rows, cols)
    clutter, bins = (data.noise, 0) if data.clutter is None else (data.clutter, len(data.clutter))
    _settle[grid](photons, data.exposure, clutter, enough, float(data.num_bins), state, own, around, bent, intensity,
                  std, background, cols, wide, SURFACES=surfaces, LAYERS=triton.next_power_of_2(surfaces), BINS=bins,
                  num_warps=1)
    return intensity, std, background
