"""Which pixels have to choose their surfaces anew, and the two copies of the state that they change."""

import triton
import triton.language as tl

from srt3d_ros.kernels.cuda.arithmetic import wrap
from srt3d_ros.kernels.cuda.maps import FIELDS, MARGIN, STD
from srt3d_ros.kernels.cuda.surfaces import agreement, has_depth, plane_depth, plane_of, record_of, surface_count


@triton.jit
def carried(record, dy, dx, max_chi2, blur2, padded_cols):
    """Depths of surfaces, carried back by (dy, dx) pixels along their planes, and what they may be off, squared."""
    std = tl.load(record + STD * padded_cols)
    return plane_depth(plane_of(record, padded_cols), -dy, -dx), max_chi2 * (std * std) + blur2


@triton.jit
def settled(state, i, j, had, max_chi2, blur2, period, padded_cols, SURFACES: tl.constexpr, NEIGHBOURS: tl.constexpr):
    """Whether nothing is to be decided at pixels (i, j).

    Where they have surfaces, all of the 3 × 3 neighbourhood belong to them, and no neighbour has fewer; where they have
    none, no neighbour has one.
    """
    q = tl.arange(0, NEIGHBOURS)[:, None]                       # surfaces of the neighbours
    dy, dx = tl.minimum(q // SURFACES, 8) // 3 - 1, tl.minimum(q // SURFACES, 8) % 3 - 1
    i_q, j_q = i + dy, j[None, :] + dx
    record = record_of(state, i_q, q % SURFACES, j_q, padded_cols, SURFACES)
    point = has_depth(record, padded_cols, period) & (q < 9 * SURFACES)
    at, variance = carried(record, dy, dx, max_chi2, blur2, padded_cols)
    known = ~point
    for k in tl.static_range(SURFACES):
        own = record_of(state, i, k, j, padded_cols, SURFACES)
        own_at, own_variance = carried(own, 0, 0, max_chi2, blur2, padded_cols)
        close = agreement(wrap(at - own_at[None, :], period), variance + own_variance[None, :])
        known = known | ((close > 0.0) & has_depth(own, padded_cols, period)[None, :])
    fewer = surface_count(state, i_q, j_q, padded_cols, period, SURFACES) < had[None, :]
    unlike, found = tl.sum((~known | (point & fewer)).to(tl.int32), axis=0), tl.sum(point.to(tl.int32), axis=0)
    return tl.where(had > 0, unlike == 0, found == 0)


@triton.jit
def undecided(exposure, state, own, max_chi2, blur2, period, padded_rows, padded_cols, one, own_one, other, own_other,
              lists, lengths, SURFACES: tl.constexpr, LIST: tl.constexpr, NEIGHBOURS: tl.constexpr):
    """Copy a state to `one` and `other`; list pixels that may choose: unsettled ones, and those with room."""
    i, part = tl.program_id(1), tl.program_id(0)
    j = part * LIST + tl.arange(0, LIST)
    if (i >= MARGIN) & (i < padded_rows - MARGIN):
        column = tl.minimum(tl.maximum(j, MARGIN), padded_cols - MARGIN - 1)
        had = surface_count(state, i, column, padded_cols, period, SURFACES)
        known = settled(state, i, column, had, max_chi2, blur2, period, padded_cols, SURFACES, NEIGHBOURS)
        used = (column == j) & (tl.load(exposure + i * padded_cols + column) > 0.0)
        listed = (used & (~known | (had < SURFACES))).to(tl.int32)
        place = (i * tl.num_programs(0) + part) * LIST + tl.cumsum(listed, axis=0) - 1
        tl.store(lists + place, j, mask=listed > 0)
        tl.store(lengths + i * tl.num_programs(0) + part, tl.sum(listed, axis=0))
    copy(state, own, one, own_one, i, j, j < padded_cols, padded_cols, SURFACES)
    copy(state, own, other, own_other, i, j, j < padded_cols, padded_cols, SURFACES)


@triton.jit
def copy(before, own_before, after, own_after, i, j, mask, padded_cols, SURFACES: tl.constexpr):
    """Copy the surfaces of pixels (i, j) and their log-likelihood ratios."""
    for k in tl.static_range(SURFACES):
        at = (i * SURFACES + k) * padded_cols + j
        tl.store(own_after + at, tl.load(own_before + at, mask=mask), mask=mask)
        for f in tl.static_range(FIELDS):
            at = ((i * SURFACES + k) * FIELDS + f) * padded_cols + j
            tl.store(after + at, tl.load(before + at, mask=mask), mask=mask)
