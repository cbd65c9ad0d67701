"""The end of a reconstruction: which points the photons speak for, how bright and how sure each is."""

import triton
import triton.language as tl

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cuda.arithmetic import EPSILON, TINY
from srt3d_ros.kernels.cuda.blur import blur
from srt3d_ros.kernels.cuda.maps import BLOCK, DEPTH, FIELDS, INTENSITY, MARGIN, RESIDUAL, SCORE, STD, TERMS, VALUE
from srt3d_ros.kernels.cuda.scratch import borrow, constant
from srt3d_ros.kernels.windows import window_weights

FAINTEST, LEAST_SHARE = tl.constexpr(constants.FAINTEST), tl.constexpr(constants.LEAST_SHARE)
SHARE_WEIGHTS = window_weights(constants.SHARE_WINDOW)


@triton.jit
def _own_intensity(terms, layer, at, light, total, mask, padded_cols):
    """Of points by the photons of their own pixels, of which `light` is the exposure, in columns `at` of a layer."""
    value = tl.load(terms + (layer * TERMS + VALUE) * padded_cols + at, mask=mask, other=0.0)
    return value / (total * tl.maximum(light, EPSILON))


@triton.jit
def _excess(counts, exposure, moments, total, state, terms, out, cols, padded_cols, SURFACES: tl.constexpr):
    i, j = tl.program_id(1), tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    inside, pixel = j < cols, (i + MARGIN) * padded_cols + j + MARGIN
    light = tl.maximum(tl.load(exposure + pixel, mask=inside, other=0.0), EPSILON)
    photons = tl.load(counts + pixel, mask=inside, other=0.0)
    for k in tl.static_range(SURFACES):
        layer = (i + MARGIN) * SURFACES + k
        pooled = tl.load(state + (layer * FIELDS + INTENSITY) * padded_cols + j + MARGIN, mask=inside, other=0.0)
        excess = _own_intensity(terms, layer, j + MARGIN, light, total, inside, padded_cols) - pooled
        signal = pooled * light
        spread = signal * tl.load(moments) + tl.maximum(photons - signal, 0.0) * tl.load(moments + 1)
        variance = spread / (total * light * (total * light))
        into = out + (i * 2 * SURFACES + k) * cols + j
        tl.store(into, tl.where(pooled > 0.0, excess * excess, 0.0), mask=inside)
        tl.store(into + SURFACES * cols, tl.where(pooled > 0.0, variance, 0.0), mask=inside)


@triton.jit
def _settle(photons, exposure, clutter, enough, period, total, state, terms, around, intensity, std, background, cols,
            padded_cols, SURFACES: tl.constexpr, LAYERS: tl.constexpr, BINS: tl.constexpr):
    """All surfaces of a pixel together: LAYERS is K or the next power of two; BINS as of `_decide`."""
    i, j, k = tl.program_id(1), tl.program_id(0) * BLOCK + tl.arange(0, BLOCK), tl.arange(0, LAYERS)[:, None]
    inside = (j < cols)[None, :] & (k < SURFACES)
    layer, at = (i + MARGIN) * SURFACES + k, (j + MARGIN)[None, :]
    light = tl.load(exposure + (i + MARGIN) * padded_cols + j + MARGIN, mask=j < cols, other=0.0)
    point = state + layer * FIELDS * padded_cols + at
    pooled = tl.load(point + INTENSITY * padded_cols, mask=inside, other=0.0)
    score = tl.load(point + SCORE * padded_cols, mask=inside, other=0.0)
    if BINS > 0:
        here = tl.floor(tl.load(point + DEPTH * padded_cols, mask=inside, other=0.0) + 0.5).to(tl.int32) % BINS
        score = score / tl.load(clutter + here)
    squares = around + (i * 2 * SURFACES + k) * cols + j[None, :]
    excess = tl.load(squares, mask=inside, other=0.0)
    differ = tl.maximum(excess - tl.load(squares + SURFACES * cols, mask=inside, other=0.0), 0.0)
    own = _own_intensity(terms, layer, at, light[None, :], total, inside, padded_cols)
    value = pooled + (own - pooled) * (differ / tl.maximum(excess, TINY))
    kept = (score > enough) & (pooled > 0.0)
    value = tl.where(kept, tl.maximum(value, pooled * LEAST_SHARE), 0.0)
    value = tl.where(value < tl.max(value, axis=0)[None, :] * FAINTEST, 0.0, value)
    sigma = tl.load(point + STD * padded_cols, mask=inside, other=0.0)
    off = tl.load(point + RESIDUAL * padded_cols, mask=inside, other=0.0)
    sigma = tl.minimum(tl.maximum(tl.sqrt(sigma * sigma + off * off), EPSILON), period)
    into = (i * SURFACES + k) * cols + j[None, :]
    tl.store(intensity + into, value, mask=inside)
    tl.store(std + into, sigma, mask=inside)
    count = tl.load(photons + i * cols + j, mask=j < cols, other=0).to(tl.float32)
    tl.store(background + i * cols + j, tl.maximum(count - tl.sum(value, axis=0) * light, 0.0), mask=j < cols)


def finalise(frame, photons, state, terms, enough, scratch=None):
    """Two kernels around `blur`."""
    (rows, cols), surfaces, padded_cols = frame.shape, state.shape[1], state.shape[3]
    grid = triton.cdiv(cols, BLOCK.value), rows
    excess, around = (borrow(scratch, name, (rows, 2 * surfaces, cols)) for name in ("excess", "around"))
    _excess[grid](frame.counts, frame.exposure, frame.intensity_moments, frame.total_energy, state, terms, excess,
                  cols, padded_cols, SURFACES=surfaces, num_warps=1)
    blur(excess, constant(SHARE_WEIGHTS), 1, around)
    intensity, std = (borrow(scratch, name, (rows, surfaces, cols)) for name in ("intensity", "std"))
    background = state.new_empty(rows, cols)
    clutter, bins = (frame.counts, 0) if frame.clutter is None else (frame.clutter, len(frame.clutter))
    _settle[grid](photons, frame.exposure, clutter, enough, float(frame.num_bins), frame.total_energy, state, terms,
                  around, intensity, std, background, cols, padded_cols, SURFACES=surfaces,
                  LAYERS=triton.next_power_of_2(surfaces), BINS=bins, num_warps=1)
    return intensity, std, background
