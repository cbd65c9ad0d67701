"""Creation, competition and removal of points: a pixel's surfaces are chosen anew among its neighbourhood's.

Few pixels have anything to decide: those at edges, and those without a surface beside some that have one. `survey`
lists them, row by row, and `_choose` works on BLOCK of a list at once, whatever lies between them, so that no thread
waits for pixels that are settled. A program's candidates are a tensor [CANDIDATES, BLOCK]: one warp owns it, and a sum
over the candidates stays inside a thread, or between few.

`survey` reads the state once and writes two copies of it. From then on only listed pixels change: each step reads
their neighbourhoods from one copy and writes them to the other, and costs next to nothing where none has room.
At m = 10 and a surface a pixel a listed pixel that has to decide takes some 5,000 operations, half of them to judge
two or three surfaces.
"""

import torch
import triton
import triton.language as tl

from srt3d_ros.core import layout
from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cuda.arithmetic import axis, sincos
from srt3d_ros.kernels.cuda.evidence import LEFT, LIKENESS, SHARING, evidence, nats
from srt3d_ros.kernels.cuda.layout import DEPTH, FIELDS, INTENSITY, MARGIN, SCORE, WINDOW
from srt3d_ros.kernels.cuda.survey import carried, is_point, record_of, resolved, settled, surfaces, survey

REACH, BELIEF, BLANK, ENOUGH, CREATE, SAME, ALONE, FILL_WINDOW, NEVER = (
    tl.constexpr(getattr(constants, name)) for name in (
        "REACH", "BELIEF", "BLANK", "ENOUGH", "CREATE", "SAME", "ALONE", "FILL_WINDOW", "NEVER"))
LEAST_VOTE, MOST_VOTE = (tl.constexpr(vote) for vote in constants.VOTES)
FALL = tl.constexpr(-0.5 / constants.VOTE_SIGMA**2)         # of a vote's weight with squared distance: exp(FALL · d²)
SIDE = tl.constexpr(2 * constants.REACH + 1)                # pixels
CENTRE = tl.constexpr(SIDE.value**2 // 2)                   # the pixel's own place among those of its neighbourhood

LONGEST_LIST = 256          # pixels of a row that share a list
PER_THREAD = 16             # candidates of a program that each thread of its warp holds in registers


@triton.jit
def _apart(one, other):
    """Differences of depths in periods, in [−1/2, 1/2]."""
    difference = one - other
    return difference - tl.floor(difference + 0.5)


@triton.jit
def _choose(matched, noise, exposure, energy, cycles, greatest, worth, moments, gate, period, window, wide, m,
            lists, lengths, before, own_before, after, own_after, also, own_also,
            FILL: tl.constexpr, SPREADS: tl.constexpr, STEPS: tl.constexpr, SURFACES: tl.constexpr, M: tl.constexpr,
            LIST: tl.constexpr, NEIGHBOURS: tl.constexpr, CANDIDATES: tl.constexpr, BLOCK: tl.constexpr):
    """Let BLOCK pixels of a list choose their surfaces; write them to `after` and, if others will follow, `also`.

    A step that only fills, after the first one, leaves pixels without room as they are.
    """
    i, part = tl.program_id(1) + MARGIN, tl.program_id(0) // (LIST // BLOCK)
    parts, first = tl.num_programs(0) // (LIST // BLOCK), tl.program_id(0) % (LIST // BLOCK) * BLOCK
    length = tl.load(lengths + i * parts + part)
    if first >= length:
        return
    place = first + tl.arange(0, BLOCK)
    listed = place < length
    j = tl.load(lists + (i * parts + part) * LIST + place, mask=listed, other=MARGIN)
    total, blur2 = resolved(energy, cycles, m, M)
    had = surfaces(before, i, j, wide, period, SURFACES)
    busy = listed & ~settled(before, i, j, had, gate, blur2, period, wide, SURFACES, NEIGHBOURS)
    if FILL:
        busy = busy & (had < SURFACES)
    if tl.max(busy.to(tl.int32), axis=0) == 0:
        if FILL:                                    # the first step finds all pixels copied
            for k in tl.static_range(SURFACES):
                own_at = (i * SURFACES + k) * wide + j
                tl.store(own_after + own_at, tl.load(own_before + own_at), mask=listed)
                for f in tl.static_range(FIELDS):
                    value = tl.load(record_of(before, i, k, j, wide, SURFACES) + f * wide)
                    tl.store(record_of(after, i, k, j, wide, SURFACES) + f * wide, value, mask=listed)
        return

    # The surfaces of the neighbourhood, carried to the pixel, in the order of their places. Depths are in periods here.
    q = tl.arange(0, CANDIDATES)[:, None]
    real, q_surface = q < SIDE * SIDE * SURFACES, q % SURFACES
    n = tl.minimum(q // SURFACES, SIDE * SIDE - 1)
    dy, dx = n // SIDE - REACH, n % SIDE - REACH
    centre, close_by = n == CENTRE, (tl.maximum(dy, -dy) <= 1) & (tl.maximum(dx, -dx) <= 1)
    i_q, j_q = i + dy, j[None, :] + dx
    record = record_of(before, i_q, q_surface, j_q, wide, SURFACES)
    point = is_point(record, wide, period) & real
    count = surfaces(before, i_q, j_q, wide, period, SURFACES)
    at, variance = carried(record, dy, dx, wide)
    at, variance = at / period, (gate * variance + blur2) / (period * period)
    weight = tl.exp((dy * dy + dx * dx) * FALL)
    vote = tl.load(own_before + (i_q * SURFACES + q_surface) * wide + j_q) + BELIEF
    vote = weight * tl.minimum(tl.maximum(vote, LEAST_VOTE), MOST_VOTE)
    strength = tl.load(record + INTENSITY * wide)
    blank = (count == 0) & (tl.load(noise + i_q * wide + j_q) > 0.0) & (q_surface == 0) & real & ~centre
    blank = tl.sum(tl.where(blank, weight, 0.0), axis=0)
    free = point

    l = tl.arange(0, M)[:, None]
    cycle, e = tl.load(cycles + l, mask=l < m, other=0.0), tl.load(energy + l, mask=l < m, other=0.0)
    sketch = matched + (i * 2 * m + l) * wide + j[None, :]
    re, im = tl.load(sketch, mask=l < m, other=0.0), tl.load(sketch + m * wide, mask=l < m, other=0.0)
    seen, photons = tl.load(exposure + i * wide + j), tl.load(noise + i * wide + j)
    lit, zero = photons > 0.0, tl.zeros_like(photons)

    for k in tl.static_range(SURFACES):
        # The free candidate with the most evidence: own photons and the neighbours' votes. Farther ones only vote.
        most = tl.where(had == 0, blank * BLANK + CREATE, CREATE if k > 0 else NEVER)
        chosen, mine, own, depth, share = listed & ~listed, tl.zeros_like(had) - 1, zero, zero, zero
        best_at, best_variance = zero, zero
        for c in range(9 * SURFACES):
            c_dy, c_dx, c_surface = c // SURFACES // 3 - 1, c // SURFACES % 3 - 1, c % SURFACES
            index = ((c_dy + REACH) * SIDE + c_dx + REACH) * SURFACES + c_surface
            c_record = record_of(before, i + c_dy, c_surface, j + c_dx, wide, SURFACES)
            eligible = busy & is_point(c_record, wide, period)
            if k > 0:
                eligible = eligible & (tl.sum((free & (q == index)).to(tl.int32), axis=0) > 0)
            c_at, c_variance = carried(c_record, c_dy, c_dx, wide)
            c_at, c_variance = c_at / period, (gate * c_variance + blur2) / (period * period)
            e_q, noisy = _apart(at, c_at[None, :]), variance + c_variance[None, :]
            judged = free & close_by & (q < index) & (e_q * e_q < noisy * (1.0 - SAME))     # with one before
            eligible = eligible & (tl.sum(judged.to(tl.int32), axis=0) == 0)
            if tl.max(eligible.to(tl.int32), axis=0) > 0:
                close = tl.maximum(1.0 - e_q * e_q / noisy, 0.0)
                agree = free & (close > 0.0)
                w = tl.where(agree, weight * close, 0.0)
                votes = tl.where(agree & ~centre, vote * close, 0.0)
                if k > 0:
                    fewer = point & ~centre & (count <= k)
                    votes = tl.where(fewer, weight * -ALONE / tl.maximum(count, 1), votes)
                votes, weights = tl.sum(votes, axis=0), tl.maximum(tl.sum(w, axis=0), 1e-12)
                where = (c_at + tl.sum(w * e_q, axis=0) / weights) * period
                expected = tl.sum(w * strength, axis=0) / weights
                its = tl.max(tl.where(agree & centre, q_surface, -1), axis=0)
                its_record = record_of(before, i, tl.maximum(its, 0), j, wide, SURFACES)
                where = tl.where(its >= 0, tl.load(its_record + DEPTH * wide), where)
                expected = tl.where(its >= 0, tl.load(its_record + INTENSITY * wide), expected)
                sine, cosine = sincos(cycle * where[None, :])
                response = tl.sum(re * cosine + im * sine, axis=0)
                photonic = nats(response, photons, tl.where(eligible, expected * seen, 1.0),
                                SHARING if k > 0 else LIKENESS, total, greatest, worth, moments, STEPS)
                agreed = (its >= 0) | (tl.sum(agree.to(tl.int32), axis=0) >= ENOUGH)
                better = eligible & agreed & (photonic + votes > most)
                most = tl.where(better, photonic + votes, most)
                chosen, mine = chosen | better, tl.where(better, its, mine)
                own, depth = tl.where(better, photonic, own), tl.where(better, where, depth)
                share = tl.where(better, tl.maximum(response, 0.0) / total, share)
                best_at, best_variance = tl.where(better, c_at, best_at), tl.where(better, c_variance, best_variance)

        # Of those that agree with it the pixel's own, if it is among them, else their mean; all of them are spent.
        e_q = _apart(at, best_at[None, :])
        close = tl.maximum(1.0 - e_q * e_q / (variance + best_variance[None, :]), 0.0)
        agree = free & (close > 0.0) & chosen[None, :]
        w = tl.where(agree, weight * close, 0.0)
        weights = tl.maximum(tl.sum(w, axis=0), 1e-12)
        free = free & ~agree
        own_record = record_of(before, i, tl.maximum(mine, 0), j, wide, SURFACES)
        old_record = record_of(before, i, k, j, wide, SURFACES)
        kept, grown = chosen & (mine >= 0), chosen & (mine < 0)
        depth = depth - period * tl.floor(depth / period)
        for f in tl.static_range(FIELDS):
            value = tl.load(tl.where(kept, own_record, old_record) + f * wide)
            if f == DEPTH:
                value = tl.where(grown, depth, value)
            elif f == WINDOW:
                value = tl.where(grown & (had == 0), FILL_WINDOW, tl.where(grown, window, value))
                value = tl.maximum(value, window)
            elif f == SCORE:
                value = tl.where(grown, 0.0, value)             # for its pool to say
            else:
                value = tl.where(grown, tl.sum(w * tl.load(record + f * wide), axis=0) / weights, value)
            if f == INTENSITY:
                value = tl.where(busy & ~chosen, 0.0, value)
            _write(after, also, ((i * SURFACES + k) * FIELDS + f) * wide + j, value, listed, SPREADS and not FILL)
        place = (i * SURFACES + k) * wide + j
        own = tl.where(busy, own, tl.load(own_before + place))
        _write(own_after, own_also, place, own, listed, SPREADS and not FILL)
        if k + 1 < SURFACES:
            share = tl.where(chosen, share, 0.0)
            photons = tl.where(chosen & lit, tl.maximum(photons - share, LEFT), photons)
            sine, cosine = sincos(cycle * depth[None, :])
            re, im = re - share[None, :] * e * cosine, im - share[None, :] * e * sine


@triton.jit
def _write(to, also, place, value, mask, TWICE: tl.constexpr):
    tl.store(to + place, value, mask=mask)
    if TWICE:
        tl.store(also + place, value, mask=mask)


def propose(data, state, window, gate, spread, scratch=None):
    """Let surfaces compete and spread: a pixel takes the neighbouring surface that photons speak for.

    The rules are told in kernels/cpu/propose.py.

    Args:
        data: the frame (see `srt3d_ros.core.frame.Frame`), padded.
        state: float32 [rows', K, FIELDS, cols'].
        window: σ of the neighbourhood that points pool from now on, at least, pixels.
        gate: as in `descend`.
        spread: pixels by which surfaces may grow into others that have room after the competition.
        scratch: not needed here: a CUDA graph keeps its memory.

    Returns:
        The next state.
    """
    tall, most, _, wide = state.shape
    m, period = len(data.energy), float(data.num_bins)
    own = evidence(data, state)
    states, owns = ([torch.empty_like(values) for _ in range(1 + (spread > 0))] for values in (state, own))
    length = min(triton.next_power_of_2(wide), LONGEST_LIST)
    parts = triton.cdiv(wide, length)
    lists = state.new_empty(tall, parts, length, dtype=torch.int32)
    lengths = state.new_empty(tall, parts, dtype=torch.int32)
    sizes = {"SPREADS": spread > 0, "SURFACES": most, "M": axis(m), "LIST": length,
             "NEIGHBOURS": triton.next_power_of_2(9 * most)}
    survey[parts, tall](data.exposure, data.energy, data.cycles, state, own, gate, period, window, tall, wide, m,
                        states[0], owns[0], states[-1], owns[-1], lists, lengths, **sizes, num_warps=length // 32)
    sizes["CANDIDATES"] = triton.next_power_of_2(SIDE.value**2 * most)
    sizes["BLOCK"] = min(32 * PER_THREAD // max(sizes["CANDIDATES"], sizes["M"]), length)
    before, own_before = state, own
    for step in range(1 + spread):
        after, own_after = states[step % 2], owns[step % 2]
        _choose[parts * length // sizes["BLOCK"], tall - 2 * layout.MARGIN](
            data.matched, data.noise, data.exposure, data.energy, data.cycles, data.greatest_response, data.rarity,
            data.intensity_moments, gate, period, window, wide, m, lists, lengths, before, own_before, after, own_after,
            states[-1], owns[-1], FILL=step > 0, STEPS=len(data.rarity) - 1, **sizes, num_warps=1)
        before, own_before = after, own_after
    return before
