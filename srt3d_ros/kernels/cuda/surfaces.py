"""What the kernels ask of surfaces: where they lie in a state, their planes, whether two depths are one surface's."""

import math

import triton
import triton.language as tl

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.cuda.maps import DEPTH, FIELDS, INTENSITY, SCORE, SLOPE_COL, SLOPE_ROW, STD

MAX_STD = tl.constexpr(maps.MAX_STD)


@triton.jit
def record_of(state, i, k, j, padded_cols, SURFACES: tl.constexpr):
    """Pointers to the first field of surfaces k of pixels (i, j)."""
    return state + (i * SURFACES + k) * FIELDS * padded_cols + j


@triton.jit
def store_surface(record, plane, intensity, std, score, mask, padded_cols):
    """Write surfaces, all fields but RESIDUAL; `plane` as of `plane_of`."""
    depth, slope_col, slope_row = plane
    tl.store(record + DEPTH * padded_cols, depth, mask=mask)
    tl.store(record + SLOPE_COL * padded_cols, slope_col, mask=mask)
    tl.store(record + SLOPE_ROW * padded_cols, slope_row, mask=mask)
    tl.store(record + INTENSITY * padded_cols, intensity, mask=mask)
    tl.store(record + STD * padded_cols, std, mask=mask)
    tl.store(record + SCORE * padded_cols, score, mask=mask)


@triton.jit
def has_depth(record, padded_cols, period):
    """Whether there is a surface, at a depth that means anything."""
    return (tl.load(record + INTENSITY * padded_cols) > 0.0) & (tl.load(record + STD * padded_cols) < period * MAX_STD)


@triton.jit
def surface_count(state, i, j, padded_cols, period, SURFACES: tl.constexpr):
    """How many surfaces pixels (i, j) have."""
    count = j - j
    for k in tl.static_range(SURFACES):
        count += has_depth(record_of(state, i, k, j, padded_cols, SURFACES), padded_cols, period).to(tl.int32)
    return count


@triton.jit
def plane_of(record, padded_cols):
    """Depths of surfaces, and their slopes to the right and downwards."""
    return (tl.load(record + DEPTH * padded_cols), tl.load(record + SLOPE_COL * padded_cols),
            tl.load(record + SLOPE_ROW * padded_cols))


@triton.jit
def plane_depth(plane, dy, dx):
    """Depths of tangent planes, of `plane_of`, (dy, dx) pixels from their surfaces."""
    depth, slope_col, slope_row = plane
    return depth + slope_row * dy + slope_col * dx


@triton.jit
def agreement(difference, variance):
    """How far depths are one surface's, 0 … 1; `variance`, above 0, is the sum of what each may be off, squared."""
    return tl.maximum(1.0 - difference * difference / variance, 0.0)


@triton.jit
def near(distance2, fall):
    """Gaussian weight by squared distance; `fall` of `fall_of`: exp2 is one instruction."""
    return tl.exp2(distance2 * fall)


def fall_of(sigma: float) -> float:
    """The factor of a squared distance with which exp(−distance² / 2σ²) is a power of 2."""
    return -0.5 / (math.log(2) * sigma**2)
