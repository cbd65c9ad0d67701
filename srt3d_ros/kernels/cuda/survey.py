"""Which pixels have to choose their surfaces anew, and what `propose` asks of a pixel's surfaces."""

import triton
import triton.language as tl

from srt3d_ros.core import layout
from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cuda.arithmetic import TURN, wrap
from srt3d_ros.kernels.cuda.layout import DEPTH, FIELDS, INTENSITY, MARGIN, SLOPE_COL, SLOPE_ROW, STD, WINDOW

ENOUGH, RESOLVED = tl.constexpr(constants.ENOUGH), tl.constexpr(constants.RESOLVED)
ASTRAY = tl.constexpr(layout.ASTRAY)


@triton.jit
def record_of(state, i, k, j, wide, SURFACES: tl.constexpr):
    """Pointers to the first field of surfaces k of pixels (i, j)."""
    return state + (i * SURFACES + k) * FIELDS * wide + j


@triton.jit
def is_point(record, wide, period):
    """Whether there is a surface, at a depth that means anything."""
    return (tl.load(record + INTENSITY * wide) > 0.0) & (tl.load(record + STD * wide) < period * ASTRAY)


@triton.jit
def surfaces(state, i, j, wide, period, SURFACES: tl.constexpr):
    """How many surfaces pixels (i, j) have."""
    count = j - j
    for k in tl.static_range(SURFACES):
        count += is_point(record_of(state, i, k, j, wide, SURFACES), wide, period).to(tl.int32)
    return count


@triton.jit
def carried(record, dy, dx, wide):
    """Depths of surfaces, carried back by (dy, dx) pixels along their planes, and their variances."""
    rise = tl.load(record + SLOPE_COL * wide) * dx + tl.load(record + SLOPE_ROW * wide) * dy
    std = tl.load(record + STD * wide)
    return tl.load(record + DEPTH * wide) - rise, std * std


@triton.jit
def settled(state, i, j, had, gate, blur2, period, wide, SURFACES: tl.constexpr, NEIGHBOURS: tl.constexpr):
    """Whether nothing is to be decided at pixels (i, j).

    Where they have surfaces, all of the 3 × 3 neighbourhood belong to them, and no neighbour has fewer; where they have
    none, hardly any neighbour has one.
    """
    q = tl.arange(0, NEIGHBOURS)[:, None]                       # surfaces of the neighbours
    dy, dx = tl.minimum(q // SURFACES, 8) // 3 - 1, tl.minimum(q // SURFACES, 8) % 3 - 1
    i_q, j_q = i + dy, j[None, :] + dx
    record = record_of(state, i_q, q % SURFACES, j_q, wide, SURFACES)
    point = is_point(record, wide, period) & (q < 9 * SURFACES)
    at, noisy = carried(record, dy, dx, wide)
    known = ~point
    for k in tl.static_range(SURFACES):
        own = record_of(state, i, k, j, wide, SURFACES)
        std, there = tl.load(own + STD * wide), is_point(own, wide, period)
        e = wrap(at - tl.load(own + DEPTH * wide)[None, :], period)
        known = known | ((e * e < gate * (noisy + (std * std)[None, :]) + 2.0 * blur2) & there[None, :])
    unlike = ~known | (point & (surfaces(state, i_q, j_q, wide, period, SURFACES) < had[None, :]))
    alike, found = tl.sum(unlike.to(tl.int32), axis=0) == 0, tl.sum(point.to(tl.int32), axis=0)
    return tl.where(had > 0, alike, found < ENOUGH)


@triton.jit
def resolved(energy, cycles, m, M: tl.constexpr):
    """Σ|ĥ_l|², and the variance within which depths are one surface, whatever their standard deviations, bins²."""
    l = tl.arange(0, M)
    e, omega = tl.load(energy + l, mask=l < m, other=0.0), tl.load(cycles + l, mask=l < m, other=0.0) * TURN
    total = tl.sum(e, axis=0)
    return total, total / tl.sum(e * omega * omega, axis=0) * (RESOLVED * RESOLVED)


@triton.jit
def survey(exposure, energy, cycles, state, own, gate, period, window, tall, wide, m, one, own_one, other, own_other,
           lists, lengths, SPREADS: tl.constexpr, SURFACES: tl.constexpr, M: tl.constexpr, LIST: tl.constexpr,
           NEIGHBOURS: tl.constexpr):
    """Copy a state, its windows widened, to `one` and, if it is to spread, `other`; list pixels that may choose.

    Those are the unsettled ones and, if surfaces are to spread, those that have room for one.
    """
    i, part = tl.program_id(1), tl.program_id(0)
    j = part * LIST + tl.arange(0, LIST)
    inside = (j >= MARGIN) & (j < wide - MARGIN)
    if (i >= MARGIN) & (i < tall - MARGIN):
        _, blur2 = resolved(energy, cycles, m, M)
        column = tl.minimum(tl.maximum(j, MARGIN), wide - MARGIN - 1)
        had = surfaces(state, i, column, wide, period, SURFACES)
        listed = ~settled(state, i, column, had, gate, blur2, period, wide, SURFACES, NEIGHBOURS)
        if SPREADS:
            listed = listed | (had < SURFACES)
        listed = (listed & inside & (tl.load(exposure + i * wide + column) > 0.0)).to(tl.int32)
        place = (i * tl.num_programs(0) + part) * LIST + tl.cumsum(listed, axis=0) - 1
        tl.store(lists + place, j, mask=listed > 0)
        tl.store(lengths + i * tl.num_programs(0) + part, tl.sum(listed, axis=0))
    else:
        inside = inside & (j < 0)
    for k in tl.static_range(SURFACES):
        at = (i * SURFACES + k) * wide + j
        value = tl.load(own + at, mask=j < wide, other=0.0)
        tl.store(own_one + at, value, mask=j < wide)
        if SPREADS:
            tl.store(own_other + at, value, mask=j < wide)
        for f in tl.static_range(FIELDS):
            at = ((i * SURFACES + k) * FIELDS + f) * wide + j
            value = tl.load(state + at, mask=j < wide, other=0.0)
            if f == WINDOW:
                value = tl.where(inside, tl.maximum(value, window), value)
            tl.store(one + at, value, mask=j < wide)
            if SPREADS:
                tl.store(other + at, value, mask=j < wide)
