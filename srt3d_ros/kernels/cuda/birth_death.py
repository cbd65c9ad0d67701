"""Birth/death update: each pixel's surfaces are chosen anew among its neighbourhood's.

Few pixels have anything to decide: those at edges, and those without a surface beside some that have one.
`_list_undecided` lists them, row by row, and writes two copies of the state. `_choose` works on BLOCK pixels of a list
at once: no thread waits for pixels that are settled. It reads their neighbourhoods from one copy and writes them to the
other. A program's candidates are a tensor [CANDIDATES, BLOCK] of one warp: sums over them stay inside few threads.
"""

import torch
import triton
import triton.language as tl

from srt3d_ros.kernels import constants, maps
from srt3d_ros.kernels.constants import SPREAD
from srt3d_ros.kernels.cuda.arithmetic import TINY, agreement, axis, fall_of, near, sincos, wrap
from srt3d_ros.kernels.cuda.likelihood import LIKENESS, SHARED_LIKENESS, left, llr
from srt3d_ros.kernels.cuda.maps import (
    DEPTH,
    FIELDS,
    INTENSITY,
    MARGIN,
    SCORE,
    carried,
    has_depth,
    record_of,
    surface_count,
)
from srt3d_ros.kernels.reference import log_likelihood_ratio

BIRTH, EMPTY_PENALTY, FEWER_PENALTY, JUDGED, MAX_VOTE, PRIOR_VOTE, VOTE_RADIUS = (
    tl.constexpr(getattr(constants, name)) for name in (
        "BIRTH", "EMPTY_PENALTY", "FEWER_PENALTY", "JUDGED", "MAX_VOTE", "PRIOR_VOTE", "VOTE_RADIUS"))
NEVER = tl.constexpr(-1e30)
FALL = tl.constexpr(fall_of(constants.VOTE_SIGMA))
SIDE = tl.constexpr(2 * constants.VOTE_RADIUS + 1)          # pixels
PLACES = tl.constexpr(triton.next_power_of_2(SIDE.value**2))
CENTRE = tl.constexpr(SIDE.value**2 // 2)                   # the pixel's own place among those of its neighbourhood

LONGEST_LIST = 256          # pixels of a row that share a list
PER_THREAD = 16             # candidates of a program that each thread of its warp holds in registers


@triton.jit
def _settled(state, i, j, had, max_chi2, blur2, period, padded_cols, SURFACES: tl.constexpr, NEIGHBOURS: tl.constexpr):
    """Whether all surfaces of the 3 × 3 neighbourhood are those of pixels (i, j), and no neighbour has fewer.

    Of pixels without any, whether no neighbour has one.
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
def _list_undecided(exposure, state, own, max_chi2, blur2, period, padded_rows, padded_cols, one, own_one, other,
                    own_other, lists, lengths, SURFACES: tl.constexpr, LIST: tl.constexpr, NEIGHBOURS: tl.constexpr):
    """Copy a state to `one` and `other`; list pixels that may choose: unsettled ones, and those with room."""
    i, part = tl.program_id(1), tl.program_id(0)
    j = part * LIST + tl.arange(0, LIST)
    if (i >= MARGIN) & (i < padded_rows - MARGIN):
        column = tl.minimum(tl.maximum(j, MARGIN), padded_cols - MARGIN - 1)
        had = surface_count(state, i, column, padded_cols, period, SURFACES)
        known = _settled(state, i, column, had, max_chi2, blur2, period, padded_cols, SURFACES, NEIGHBOURS)
        used = (column == j) & (tl.load(exposure + i * padded_cols + column) > 0.0)
        listed = (used & (~known | (had < SURFACES))).to(tl.int32)
        place = (i * tl.num_programs(0) + part) * LIST + tl.cumsum(listed, axis=0) - 1
        tl.store(lists + place, j, mask=listed > 0)
        tl.store(lengths + i * tl.num_programs(0) + part, tl.sum(listed, axis=0))
    _copy(state, own, one, own_one, i, j, j < padded_cols, padded_cols, SURFACES)
    _copy(state, own, other, own_other, i, j, j < padded_cols, padded_cols, SURFACES)


@triton.jit
def _copy(before, own_before, after, own_after, i, j, mask, padded_cols, SURFACES: tl.constexpr):
    """Copy the surfaces of pixels (i, j) and their log-likelihood ratios."""
    for k in tl.static_range(SURFACES):
        at = (i * SURFACES + k) * padded_cols + j
        tl.store(own_after + at, tl.load(own_before + at, mask=mask), mask=mask)
        for f in tl.static_range(FIELDS):
            at = ((i * SURFACES + k) * FIELDS + f) * padded_cols + j
            tl.store(after + at, tl.load(before + at, mask=mask), mask=mask)


@triton.jit
def _candidates(counts, exposure, state, own, i, j, max_chi2, blur2, period, padded_cols, SURFACES: tl.constexpr,
                CANDIDATES: tl.constexpr):
    """The surfaces of the neighbourhood, carried to pixels (i, j), in the order of their places: [CANDIDATES, BLOCK].

    Returns:
        Their numbers, surfaces, whether they are the pixel's own, and whether of its 3 × 3 neighbourhood; their
        records, whether they exist, how many surfaces their pixels have, depths and what these may be off, squared,
        weights and votes; and the weights [BLOCK] of the pixels around without a surface: with photons, and without.
    """
    q = tl.arange(0, CANDIDATES)[:, None]
    real, surface = q < SIDE * SIDE * SURFACES, q % SURFACES
    n = tl.minimum(q // SURFACES, SIDE * SIDE - 1)
    dy, dx = n // SIDE - VOTE_RADIUS, n % SIDE - VOTE_RADIUS
    mine, close_by = n == CENTRE, (tl.maximum(dy, -dy) <= 1) & (tl.maximum(dx, -dx) <= 1)
    i_q, j_q = i + dy, j[None, :] + dx
    record = record_of(state, i_q, surface, j_q, padded_cols, SURFACES)
    point = has_depth(record, padded_cols, period) & real
    count = surface_count(state, i_q, j_q, padded_cols, period, SURFACES)
    at, variance = carried(record, dy, dx, max_chi2, blur2, padded_cols)
    weight = near(dy * dy + dx * dx, FALL)
    vote = tl.load(own + (i_q * SURFACES + surface) * padded_cols + j_q) + PRIOR_VOTE
    vote = weight * tl.minimum(tl.maximum(vote, 0.0), MAX_VOTE)
    blank = (count == 0) & (tl.load(exposure + i_q * padded_cols + j_q) > 0.0) & (surface == 0) & real & ~mine
    lit, blank = tl.load(counts + i_q * padded_cols + j_q) > 0.0, tl.where(blank, weight, 0.0)
    places, values = (q, surface, mine, close_by), (record, point, count, at, variance, weight, vote)
    return places, values, tl.sum(tl.where(lit, blank, 0.0), axis=0), tl.sum(tl.where(lit, 0.0, blank), axis=0)


@triton.jit
def _support(k, agree, close, e, places, values, padded_cols):
    """Votes (nats) for a candidate as surface k; of those that agree with it mean difference in depth, mean intensity,
    and which is the pixel's own surface, or −1.
    """
    _, surface, mine, _ = places
    record, point, count, _, _, weight, vote = values
    w = tl.where(agree, weight * close, 0.0)
    votes = tl.where(agree & ~mine, vote * close, 0.0)
    if k > 0:
        fewer = point & ~mine & (count <= k)
        votes = tl.where(fewer, weight * -FEWER_PENALTY / tl.maximum(count, 1), votes)
    weights = tl.maximum(tl.sum(w, axis=0), TINY)
    shift = tl.sum(w * e, axis=0) / weights
    intensity = tl.sum(w * tl.load(record + INTENSITY * padded_cols), axis=0) / weights
    return tl.sum(votes, axis=0), shift, intensity, tl.max(tl.where(agree & mine, surface, -1), axis=0)


@triton.jit
def _best(k, least, unseen, busy, free, places, values, rest, photons, light, frequency, total, max_response,
          background_table, moments, state, i, j, max_chi2, blur2, period, padded_cols, STEPS: tl.constexpr,
          SURFACES: tl.constexpr):
    """The free candidate of the 3 × 3 neighbourhood with the highest log-likelihood ratio above `least`, and less
    `unseen` nats times the probability that a pixel sees any of its photons.

    Returns:
        Whether there is one, which surface of the pixel's own agrees with it or −1, the ratio by the pixel's own
        photons, its depth, the pixel's photons from there, and the candidate's own depth and what it may be off.
    """
    q, _, _, close_by = places
    _, _, _, at, variance, _, _ = values
    re, im = rest
    zero = tl.zeros_like(light)
    chosen, mine, own, depth, share, best_at, best_variance = busy & ~busy, j - j - 1, zero, zero, zero, zero, zero
    for c in range(9 * SURFACES):
        dy, dx, surface = c // SURFACES // 3 - 1, c // SURFACES % 3 - 1, c % SURFACES
        index = ((dy + VOTE_RADIUS) * SIDE + dx + VOTE_RADIUS) * SURFACES + surface
        record = record_of(state, i + dy, surface, j + dx, padded_cols, SURFACES)
        eligible = busy & has_depth(record, padded_cols, period)
        if k > 0:
            eligible = eligible & (tl.sum((free & (q == index)).to(tl.int32), axis=0) > 0)
        c_at, c_variance = carried(record, dy, dx, max_chi2, blur2, padded_cols)
        e = wrap(at - c_at[None, :], period)
        close = agreement(e, variance + c_variance[None, :])
        judged = free & close_by & (q < index) & (close > JUDGED)                 # with one before
        eligible = eligible & (tl.sum(judged.to(tl.int32), axis=0) == 0)
        if tl.max(eligible.to(tl.int32), axis=0) > 0:
            agree = free & (close > 0.0)
            votes, shift, intensity, its = _support(k, agree, close, e, places, values, padded_cols)
            own_record = record_of(state, i, tl.maximum(its, 0), j, padded_cols, SURFACES)
            where = tl.where(its >= 0, tl.load(own_record + DEPTH * padded_cols), c_at + shift)
            intensity = tl.where(its >= 0, tl.load(own_record + INTENSITY * padded_cols), intensity)
            sine, cosine = sincos(frequency * where[None, :])
            response = tl.sum(re * cosine + im * sine, axis=0)
            ratio = llr(response, photons, tl.where(eligible, intensity * light, 1.0),
                        SHARED_LIKENESS if k > 0 else LIKENESS, total, max_response, background_table, moments, STEPS)
            votes -= unseen * (1.0 - tl.exp(intensity * light * -1.0))
            better = eligible & (ratio + votes > least)
            least = tl.where(better, ratio + votes, least)
            chosen, mine = chosen | better, tl.where(better, its, mine)
            own, depth = tl.where(better, ratio, own), tl.where(better, where, depth)
            share = tl.where(better, tl.maximum(response, 0.0) / total, share)
            best_at, best_variance = tl.where(better, c_at, best_at), tl.where(better, c_variance, best_variance)
    return chosen, mine, own, depth - period * tl.floor(depth / period), share, best_at, best_variance


@triton.jit
def _join(f, k, busy, chosen, mine, depth, w, values, state, i, j, padded_cols, SURFACES: tl.constexpr):
    """Field f of surface k: of the pixel's own surface `mine`, or what agrees, averaged by w; unchanged if idle."""
    grown = chosen & (mine < 0)
    old = tl.where(chosen & (mine >= 0), mine, k)
    value = tl.load(record_of(state, i, old, j, padded_cols, SURFACES) + f * padded_cols)
    if f == DEPTH:
        value = tl.where(grown, depth, value)
    elif f == SCORE:
        value = tl.where(grown, 0.0, value)                     # for its pool to say
    else:
        record, _, _, _, _, _, _ = values
        mean = tl.sum(w * tl.load(record + f * padded_cols), axis=0) / tl.maximum(tl.sum(w, axis=0), TINY)
        value = tl.where(grown, mean, value)
    if f == INTENSITY:
        value = tl.where(busy & ~chosen, 0.0, value)
    return value


@triton.jit
def _stirred(changed, i, j, padded_cols):
    n = tl.minimum(tl.arange(0, PLACES), SIDE * SIDE - 1)[:, None]
    place = (i + n // SIDE - VOTE_RADIUS) * padded_cols + j[None, :] + n % SIDE - VOTE_RADIUS
    return tl.max(tl.load(changed + place).to(tl.int32), axis=0) > 0


@triton.jit
def _choose(matched, counts, exposure, energy, bin_frequencies, total, max_response, background_table, moments,
            max_chi2, blur2, period, padded_cols, m, lists, lengths, before, own_before, changed, after, own_after,
            changes, FILL: tl.constexpr, STEPS: tl.constexpr, SURFACES: tl.constexpr, M: tl.constexpr,
            LIST: tl.constexpr, NEIGHBOURS: tl.constexpr, CANDIDATES: tl.constexpr, BLOCK: tl.constexpr):
    """Let BLOCK pixels of a list choose surfaces; with FILL only those with room around which something has changed."""
    i, part = tl.program_id(1) + MARGIN, tl.program_id(0) // (LIST // BLOCK)
    parts, first = tl.num_programs(0) // (LIST // BLOCK), tl.program_id(0) % (LIST // BLOCK) * BLOCK
    length = tl.load(lengths + i * parts + part)
    if first >= length:
        return
    place = first + tl.arange(0, BLOCK)
    listed = place < length
    j = tl.load(lists + (i * parts + part) * LIST + place, mask=listed, other=MARGIN)
    had = surface_count(before, i, j, padded_cols, period, SURFACES)
    busy = listed
    if FILL:
        busy = busy & (had < SURFACES) & _stirred(changed, i, j, padded_cols)
    if tl.max(busy.to(tl.int32), axis=0) > 0:
        busy = busy & ~_settled(before, i, j, had, max_chi2, blur2, period, padded_cols, SURFACES, NEIGHBOURS)
    if tl.max(busy.to(tl.int32), axis=0) == 0:
        if FILL:                                    # the first time finds all pixels copied, and none changed
            tl.store(changes + i * padded_cols + j, 0, mask=listed)
            _copy(before, own_before, after, own_after, i, j, listed, padded_cols, SURFACES)
        return

    places, values, blank, dark = _candidates(counts, exposure, before, own_before, i, j, max_chi2, blur2, period,
                                              padded_cols, SURFACES, CANDIDATES)
    unseen = tl.where(had == 0, dark * EMPTY_PENALTY, 0.0)
    _, free, _, at, variance, weight, _ = values
    l = tl.arange(0, M)[:, None]
    frequency = tl.load(bin_frequencies + l, mask=l < m, other=0.0)
    spectrum = tl.load(energy + l, mask=l < m, other=0.0)
    sketch = matched + (i * 2 * m + l) * padded_cols + j[None, :]
    rest = tl.load(sketch, mask=l < m, other=0.0), tl.load(sketch + m * padded_cols, mask=l < m, other=0.0)
    light, photons = tl.load(exposure + i * padded_cols + j), tl.load(counts + i * padded_cols + j)
    differs = busy & ~busy
    for k in tl.static_range(SURFACES):
        least = tl.where(had == 0, blank * EMPTY_PENALTY + BIRTH, BIRTH if k > 0 else NEVER)
        chosen, mine, own, depth, share, best_at, best_variance = _best(
            k, least, unseen, busy, free, places, values, rest, photons, light, frequency, total, max_response,
            background_table, moments, before, i, j, max_chi2, blur2, period, padded_cols, STEPS, SURFACES)
        close = agreement(wrap(at - best_at[None, :], period), variance + best_variance[None, :])
        agree = free & (close > 0.0) & chosen[None, :]
        free = free & ~agree                        # what agrees with the one chosen is spent
        w = tl.where(agree, weight * close, 0.0)
        there = tl.load(record_of(before, i, k, j, padded_cols, SURFACES) + INTENSITY * padded_cols) > 0.0
        differs = differs | (busy & tl.where(chosen, mine != k, there))
        for f in tl.static_range(FIELDS):
            value = _join(f, k, busy, chosen, mine, depth, w, values, before, i, j, padded_cols, SURFACES)
            tl.store(record_of(after, i, k, j, padded_cols, SURFACES) + f * padded_cols, value, mask=listed)
        own_at = (i * SURFACES + k) * padded_cols + j
        tl.store(own_after + own_at, tl.where(busy, own, tl.load(own_before + own_at)), mask=listed)
        if k + 1 < SURFACES:
            share = tl.where(chosen, share, 0.0)
            photons = left(photons, share)
            re, im = rest
            sine, cosine = sincos(frequency * depth[None, :])
            rest = re - share[None, :] * spectrum * cosine, im - share[None, :] * spectrum * sine
    tl.store(changes + i * padded_cols + j, differs.to(tl.int8), mask=listed)


def birth_death(frame, state, terms, max_chi2, scratch=None):
    """`scratch` is not used: a CUDA graph keeps its memory."""
    padded_rows, most, _, padded_cols = state.shape
    m, period, blur2 = len(frame.energy), float(frame.num_bins), (constants.RESOLVED * frame.resolution_bins)**2
    own = log_likelihood_ratio(frame, state, terms)
    states, owns = ([torch.empty_like(values) for _ in range(2)] for values in (state, own))
    changed, changes = (torch.zeros_like(frame.counts, dtype=torch.int8) for _ in range(2))
    length = min(triton.next_power_of_2(padded_cols), LONGEST_LIST)
    parts = triton.cdiv(padded_cols, length)
    lists = state.new_empty(padded_rows, parts, length, dtype=torch.int32)
    lengths = state.new_empty(padded_rows, parts, dtype=torch.int32)
    sizes = {"SURFACES": most, "LIST": length, "NEIGHBOURS": triton.next_power_of_2(9 * most)}
    _list_undecided[parts, padded_rows](
        frame.exposure, state, own, max_chi2, blur2, period, padded_rows, padded_cols, states[0], owns[0],
        states[1], owns[1], lists, lengths, **sizes, num_warps=length // 32)
    candidates = triton.next_power_of_2(SIDE.value**2 * most)
    block = min(32 * PER_THREAD // max(candidates, axis(m)), length)
    before, own_before = state, own
    for step in range(1 + SPREAD):
        after, own_after = states[step % 2], owns[step % 2]
        _choose[parts * length // block, padded_rows - 2 * maps.MARGIN](
            frame.matched, frame.counts, frame.exposure, frame.energy, frame.bin_frequencies, frame.total_energy,
            frame.max_response, frame.background_table, frame.intensity_moments, max_chi2, blur2, period, padded_cols,
            m, lists, lengths, before, own_before, changed, after, own_after, changes, FILL=step > 0,
            STEPS=len(frame.background_table) - 1, M=axis(m), CANDIDATES=candidates, BLOCK=block,
            **sizes, num_warps=1)
        before, own_before, changed, changes = after, own_after, changes, changed
    return before
