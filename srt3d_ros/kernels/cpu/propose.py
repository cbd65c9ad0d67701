"""Creation, competition and removal of points: a pixel's surfaces are chosen anew among its neighbourhood's."""

import numpy as np
from numba import get_num_threads, prange

from srt3d_ros.core.layout import ASTRAY, DEPTH, INTENSITY, MARGIN, SCORE, SLOPE_COL, SLOPE_ROW, STD, WINDOW
from srt3d_ros.kernels import constants
from srt3d_ros.kernels.constants import ENOUGH, REACH, RESOLVED, VOTE_SIGMA
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO, fair_order, sincos, total_of, wrap
from srt3d_ros.kernels.cpu.compiling import inline, parallel
from srt3d_ros.kernels.cpu.evidence import LEFT, LIKENESS, SHARING, evidence, nats
from srt3d_ros.kernels.cpu.fields import B, U
from srt3d_ros.kernels.cpu.match import response_at
from srt3d_ros.kernels.cpu.scratch import borrow
from srt3d_ros.kernels.cpu.survey import HAD, OPEN, survey, survey_scratch

ALONE, BELIEF, BLANK, CREATE, FILL_WINDOW, NEVER, SAME = (F32(getattr(constants, name)) for name in (
    "ALONE", "BELIEF", "BLANK", "CREATE", "FILL_WINDOW", "NEVER", "SAME"))
VOTES = F32(constants.VOTES[0]), F32(constants.VOTES[1])
NEAR = tuple(F32(np.exp(-d / (2 * VOTE_SIGMA**2))) for d in range(2 * REACH**2 + 1))  # a vote's weight by distance²

# Columns of the candidates' tables.
ROW, COL, SURFACE, COUNT, OWN, FREE = range(6)
AT, VARIANCE, WEIGHT, VOTE = range(4)


@inline
def _is_point(state, i, k, j, period):
    """Whether pixel (i, j) has a surface k, at a depth that means anything."""
    return state[i, k, INTENSITY, j] > ZERO and state[i, k, STD, j] < F32(ASTRAY) * period


@inline
def _surfaces(state, i, j, period):
    """How many surfaces pixel (i, j) has."""
    count = 0
    for k in range(state.shape[1]):
        count += 1 if _is_point(state, i, k, j, period) else 0
    return count


@inline
def _candidates(i, j, state, own, noise, gate, blur2, period, values, info):
    """Collect the surfaces of the neighbourhood, carried to pixel (i, j) along their planes.

    Returns how many there are, and the weight of the pixels around that see photons, but no surface.
    """
    found, blank = 0, ZERO
    for di in range(-REACH, REACH + 1):
        for dj in range(-REACH, REACH + 1):
            a, b = i + di, j + dj
            count = _surfaces(state, a, b, period)
            if count == 0 and noise[a, b] > ZERO and (di != 0 or dj != 0):
                blank += NEAR[di * di + dj * dj]
            for k in range(state.shape[1]):
                if _is_point(state, a, k, b, period):
                    rise = state[a, k, SLOPE_COL, b] * F32(dj) + state[a, k, SLOPE_ROW, b] * F32(di)
                    values[found, AT] = state[a, k, DEPTH, b] - rise
                    values[found, VARIANCE] = gate * state[a, k, STD, b] * state[a, k, STD, b] + blur2
                    weight = NEAR[di * di + dj * dj]
                    values[found, WEIGHT] = weight
                    values[found, VOTE] = weight * min(max(BELIEF + own[a, k, b], VOTES[0]), VOTES[1])
                    info[found, ROW], info[found, COL], info[found, SURFACE] = a, b, k
                    info[found, COUNT], info[found, FREE] = count, 1
                    info[found, OWN] = 1 if di == 0 and dj == 0 else 0
                    found += 1
    return found, blank


@inline
def _agreement(q, c, values, period):
    """How far two candidates are one surface, 0 … 1, and their difference in depth."""
    e = wrap(values[q, AT] - values[c, AT], period)
    return max(ONE - e * e / (values[q, VARIANCE] + values[c, VARIANCE]), ZERO), e


@inline
def _support(c, k, found, values, info, state, period):
    """What the neighbourhood says of candidate c as the pixel's surface k.

    Returns the votes (nats), depth, intensity, number of agreeing candidates, and which is the pixel's own or −1.
    """
    votes, shift, weight, intensity, count, mine = ZERO, ZERO, ZERO, ZERO, 0, -1
    for q in range(found):
        close, e = _agreement(q, c, values, period)
        w = values[q, WEIGHT]
        if k > 0 and info[q, OWN] == 0 and info[q, COUNT] <= k:
            votes -= w * ALONE / F32(info[q, COUNT])
        elif info[q, FREE] == 1 and close > ZERO:
            votes += values[q, VOTE] * close if info[q, OWN] == 0 else ZERO
        if info[q, FREE] == 1 and close > ZERO:
            mine = q if info[q, OWN] == 1 else mine
            weight += w * close
            shift += w * close * e
            intensity += w * close * state[info[q, ROW], info[q, SURFACE], INTENSITY, info[q, COL]]
            count += 1
    at, intensity = values[c, AT] + shift / weight, intensity / weight
    if mine >= 0:
        at = values[mine, AT]
        intensity = state[info[mine, ROW], info[mine, SURFACE], INTENSITY, info[mine, COL]]
    return votes, at, intensity, count, mine


@inline
def _best(k, least, i, j, found, values, info, state, rest, photons, exposure, cycles, period, total, greatest, worth,
          moments):
    """The free candidate with the most evidence, above `least`, or −1: own photons and the neighbours' votes.

    Only candidates of the 3 × 3 neighbourhood are chosen from: farther ones vote.

    Returns the candidate, the evidence of the pixel's own photons, the depth, which candidate is the pixel's own or −1,
    and the pixel's photons from there.
    """
    best, evidence, own, at, mine, share = -1, least, ZERO, ZERO, -1, ZERO
    for c in range(found):
        if info[c, FREE] == 0 or abs(info[c, ROW] - i) > 1 or abs(info[c, COL] - j) > 1:
            continue
        judged = False                              # as one with a candidate before
        for q in range(c):
            if info[q, FREE] == 1 and abs(info[q, ROW] - i) <= 1 and abs(info[q, COL] - j) <= 1:
                close, _ = _agreement(q, c, values, period)
                judged = judged or close > SAME
        if judged:
            continue
        votes, where, intensity, count, its = _support(c, k, found, values, info, state, period)
        response = response_at(rest, 0, 1, cycles, where)
        photonic = nats(response, photons, intensity * exposure, SHARING if k > 0 else LIKENESS, total, greatest,
                        worth, moments)
        if photonic + votes > evidence and (its >= 0 or count >= ENOUGH):
            best, evidence, own, at, mine = c, photonic + votes, photonic, where, its
            share = max(response, ZERO) / total
    return best, own, at, mine, share


@inline
def _join(c, found, at, state, values, info, period, record):
    """Spend the candidates that agree with c; write their mean, at depth `at`, into `record`."""
    record[:] = ZERO
    weight = ZERO
    for q in range(found):
        close, _ = _agreement(q, c, values, period)
        if info[q, FREE] == 1 and close > ZERO:
            info[q, FREE] = 0
            w = values[q, WEIGHT] * close
            weight += w
            for f in range(len(record)):
                record[f] += w * state[info[q, ROW], info[q, SURFACE], f, info[q, COL]]
    for f in range(len(record)):
        record[f] /= weight
    record[DEPTH] = at - period * np.floor(at / period)


@inline
def _explain(rest, at, photons, energy, cycles):
    """Take the photons from a surface out of a pixel's sketch."""
    m = len(energy)
    for l in range(m):
        sine, cosine = sincos(cycles[l] * at)
        rest[l] -= photons * energy[l] * cosine
        rest[m + l] -= photons * energy[l] * sine


@parallel
def _propose(matched, noise, exposure, energy, cycles, num_bins, greatest, worth, moments, gate, blur2, window, fill,
             before, own_before, after, own_after, order):
    tall, surfaces, fields, wide = before.shape
    period, total = F32(num_bins), total_of(energy)
    most, astray = (2 * REACH + 1)**2 * surfaces, F32(ASTRAY) * period
    flat = before.reshape(-1)
    for turn in prange(tall - 2 * MARGIN):
        i = order[turn] + MARGIN
        values, info = np.empty((most, 4), np.float32), np.empty((most, 6), np.int64)
        s = survey_scratch()
        rest, record = np.empty(2 * len(energy), np.float32), np.empty(fields, np.float32)
        for k in range(surfaces):
            for f in range(fields):
                after[i, k, f] = before[i, k, f]
            after[i, k, WINDOW] = np.maximum(before[i, k, WINDOW], window)
            own_after[i, k] = own_before[i, k]
        for j in range(MARGIN, wide - MARGIN):
            x = U(j - MARGIN) % B
            if x == 0:
                survey(s, flat, i * surfaces * fields * wide + j, surfaces, U(wide), gate, blur2, period, astray,
                       fill)
            had = int(s[HAD + x])
            if s[OPEN + x] == ZERO or exposure[i, j] <= ZERO or (fill and had == surfaces):
                continue
            found, blank = _candidates(i, j, before, own_before, noise, gate, blur2, period, values, info)
            rest[:] = matched[i, :, j]
            photons = noise[i, j]
            for k in range(surfaces):
                least = CREATE if k > 0 or had == 0 else NEVER
                least += BLANK * blank if had == 0 else ZERO
                c, own, at, mine, share = _best(k, least, i, j, found, values, info, before, rest, photons,
                                                exposure[i, j], cycles, period, total, greatest, worth, moments)
                if c < 0:
                    after[i, k, INTENSITY, j], own_after[i, k, j] = ZERO, ZERO
                    continue
                _join(c, found, at, before, values, info, period, record)
                if mine >= 0:
                    record[:] = before[i, info[mine, SURFACE], :, j]
                    record[WINDOW] = max(record[WINDOW], window)
                else:
                    record[WINDOW] = window if had > 0 else max(window, FILL_WINDOW)
                    record[SCORE] = ZERO                            # for its pool to say
                after[i, k, :, j], own_after[i, k, j] = record, own
                photons = max(photons - share, LEFT) if noise[i, j] > ZERO else ZERO
                _explain(rest, record[DEPTH], share, energy, cycles)


def propose(data, state, window, gate, spread, scratch=None):
    """Let surfaces compete and spread: a pixel takes the neighbouring surface that photons speak for.

    The evidence for a surface is that of the pixel's own photons (`evidence.nats`) and a vote from each pixel around
    that shows the surface, worth more the more its own photons speak for it: so what is known of a boundary decides
    where it runs through pixels with no photons. A pixel at an edge chooses again between both sides; a pixel without a
    surface gets one if three neighbours have it and the evidence is for it. A further surface needs evidence against
    neighbours that have fewer: so pixels that truly see two surfaces keep both, and edges show no double points.

    Args:
        data: the frame (see `srt3d_ros.core.frame.Frame`), padded.
        state: float32 [rows', K, FIELDS, cols'].
        window: σ of the neighbourhood that points pool from now on, at least, pixels.
        gate: as in `descend`.
        spread: pixels by which surfaces may grow into others that have room after the competition.
        scratch: where results may lie until the next call.

    Returns:
        The next state.
    """
    # Depths nearer than the sketch can resolve are one surface, whatever their standard deviations.
    blur2 = F32(RESOLVED * data.resolution_bins)**2
    own = evidence(data, state, borrow(scratch, "evidence", state[:, :, 0].shape))
    order = fair_order(state.shape[0] - 2 * MARGIN, get_num_threads())
    for step in range(1 + spread):
        if step > 0 and not ((state[:, :, INTENSITY] <= ZERO).any(axis=1) & (data.exposure > ZERO)).any():
            break
        after = borrow(scratch, f"proposed {step % 2}", state.shape, scratch is None)
        own_after = borrow(scratch, f"own {step % 2}", own.shape, scratch is None)
        _propose(data.matched, data.noise, data.exposure, data.energy, data.cycles, data.num_bins,
                 F32(data.greatest_response), data.rarity, data.intensity_moments, F32(gate), blur2, F32(window),
                 step > 0, state, own, after, own_after, order)
        state, own = after, own_after
    return state
