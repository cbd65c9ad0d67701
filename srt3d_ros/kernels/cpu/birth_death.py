"""Birth/death update: each pixel's surfaces are chosen anew among its neighbourhood's."""

import numpy as np
from numba import get_num_threads, prange

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.constants import NEAR_SIGMA, RESOLVED, SPREAD, VOTE_RADIUS
from srt3d_ros.kernels.cpu.arithmetic import (
    DEPTH,
    F32,
    INTENSITY,
    ONE,
    SCORE,
    SLOPE_COL,
    SLOPE_ROW,
    STD,
    ZERO,
    B,
    U,
    agreement,
    aligned,
    any_of,
    copy,
    fair_order,
    is_surface,
    rise,
    total_of,
    wrap,
)
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.likelihood import LIKENESS, SHARED_LIKENESS, left, llr, log_likelihood_ratio
from srt3d_ros.kernels.cpu.match import response_at, subtract
from srt3d_ros.kernels.maps import BLOCK, FIELDS, MARGIN, MAX_STD

BIRTH, EMPTY_PENALTY, FEWER_PENALTY, SAME_CANDIDATE, MAX_VOTE, PRIOR_VOTE = (F32(getattr(constants, name)) for name in (
    "BIRTH", "EMPTY_PENALTY", "FEWER_PENALTY", "SAME_CANDIDATE", "MAX_VOTE", "PRIOR_VOTE"))
NEVER = F32(-1e30)
# A vote's weight by distance².
BY_DISTANCE = tuple(F32(np.exp(-d / (2 * NEAR_SIGMA**2))) for d in range(2 * VOTE_RADIUS**2 + 1))

# Offsets into the scratch of `_find_undecided`, for numbers of BLOCK pixels.
OWN, FOUND, OPEN, NUMBER, THERE, KNOWN, PLACE, LIMIT = (U(k * BLOCK) for k in range(8))
# Columns of the candidates' tables; NEAR is a list of candidates by itself.
ROW, COL, SURFACE, COUNT, MINE, FREE, NEAR = range(7)
AT, TOLERANCE, WEIGHT, VOTE = range(4)


@inline
def _compare(s, state, at, here, surfaces, padded_cols, dx, dy, max_chi2, blur2, period, max_std):
    """Count the surface of a neighbour at (dx, dy), whose depth is at `at`, and open pixels that do not know it."""
    for x in range(B):
        std = state[at + STD * padded_cols + x]
        there = is_surface(state[at + INTENSITY * padded_cols + x], std, max_std)
        s[THERE + x] = ONE if there else ZERO
        s[LIMIT + x] = max_chi2 * std * std + blur2 + blur2
        s[KNOWN + x] = ZERO
    for x in range(B):
        s[PLACE + x] = state[at + DEPTH * padded_cols + x] - rise(
            state[at + SLOPE_COL * padded_cols + x], state[at + SLOPE_ROW * padded_cols + x], dx, dy)
    for k in range(surfaces):
        mine = U(here + k * FIELDS * padded_cols)
        for x in range(B):
            e = wrap(s[PLACE + x] - state[mine + DEPTH * padded_cols + x], period)
            std = state[mine + STD * padded_cols + x]
            same = (e * e < s[LIMIT + x] + max_chi2 * std * std) & is_surface(
                state[mine + INTENSITY * padded_cols + x], std, max_std)
            s[KNOWN + x] = ONE if same else s[KNOWN + x]
    for x in range(B):
        s[NUMBER + x] += s[THERE + x]
        strange = (s[THERE + x] > ZERO) & (s[KNOWN + x] == ZERO)
        s[OPEN + x] = ONE if strange else s[OPEN + x]


@line
def _find_undecided(s, state, here, surfaces, padded_cols, max_chi2, blur2, period, max_std):
    """Set BLOCK numbers from OPEN on in s to 1 where something is to be decided, else 0; from OWN on: own surfaces.

    A pixel with surfaces is decided if all of the 3 × 3 neighbourhood belong to them, and no neighbour has fewer; one
    without surfaces, if no neighbour has one. `here` is the index of the first pixel's depth in the flat state.
    """
    for x in range(B):
        s[OWN + x], s[FOUND + x], s[OPEN + x] = ZERO, ZERO, ZERO
    for k in range(surfaces):
        mine = U(here + k * FIELDS * padded_cols)
        for x in range(B):
            there = is_surface(state[mine + INTENSITY * padded_cols + x], state[mine + STD * padded_cols + x], max_std)
            s[OWN + x] += ONE if there else ZERO
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            if dx == 0 and dy == 0:             # the pixel's own
                continue
            for x in range(B):
                s[NUMBER + x] = ZERO
            for q in range(surfaces):
                at = U(here + (dy * surfaces + q) * FIELDS * padded_cols + dx)
                _compare(s, state, at, here, surfaces, padded_cols, F32(dx), F32(dy), max_chi2, blur2, period, max_std)
            for x in range(B):
                s[FOUND + x] += s[NUMBER + x]
                fewer = (s[NUMBER + x] > ZERO) & (s[NUMBER + x] < s[OWN + x])
                s[OPEN + x] = ONE if fewer else s[OPEN + x]
    for x in range(B):
        gap = ONE if s[FOUND + x] > ZERO else ZERO
        s[OPEN + x] = gap if s[OWN + x] == ZERO else s[OPEN + x]


@line
def _collect(i, j, state, own, counts, exposure, max_chi2, blur2, max_std, values, info):
    """Collect the surfaces of the neighbourhood, carried to pixel (i, j) along their planes.

    Returns how many there are, how many are the pixel's, and the weights of pixels without any: with photons, without.
    """
    found, mine, blank, dark = 0, 0, ZERO, ZERO
    for di in range(-VOTE_RADIUS, VOTE_RADIUS + 1):
        for dj in range(-VOTE_RADIUS, VOTE_RADIUS + 1):
            a, b, weight, first = i + di, j + dj, BY_DISTANCE[di * di + dj * dj], found
            for k in range(state.shape[1]):
                if is_surface(state[a, k, INTENSITY, b], state[a, k, STD, b], max_std):
                    values[found, AT] = state[a, k, DEPTH, b] - rise(state[a, k, SLOPE_COL, b],
                                                                     state[a, k, SLOPE_ROW, b], F32(dj), F32(di))
                    values[found, TOLERANCE] = max_chi2 * state[a, k, STD, b] * state[a, k, STD, b] + blur2
                    values[found, WEIGHT] = weight
                    values[found, VOTE] = weight * min(max(PRIOR_VOTE + own[a, k, b], ZERO), MAX_VOTE)
                    info[found, ROW], info[found, COL], info[found, SURFACE], info[found, FREE] = a, b, k, 1
                    info[found, MINE] = 1 if di == 0 and dj == 0 else 0
                    found += 1
            for q in range(first, found):
                info[q, COUNT] = found - first
            if di == 0 and dj == 0:
                mine = found - first
            elif found == first and counts[a, b] > ZERO:
                blank += weight
            elif found == first and exposure[a, b] > ZERO:
                dark += weight
    return found, mine, blank, dark


@inline
def _agree(q, c, values, period):
    """How far two candidates are one surface, and their difference in depth."""
    e, tolerance = wrap(values[q, AT] - values[c, AT], period), values[q, TOLERANCE] + values[c, TOLERANCE]
    return agreement(e, tolerance) if e * e < tolerance else ZERO, e


@line
def _support(c, k, found, values, info, state, period):
    """Votes (nats) for candidate c as surface k, depth, intensity, and which one that agrees is the pixel's or −1."""
    votes, shift, weight, intensity, mine = ZERO, ZERO, ZERO, ZERO, -1
    for q in range(found):
        same, e = _agree(q, c, values, period)
        w = values[q, WEIGHT]
        if k > 0 and info[q, MINE] == 0 and info[q, COUNT] <= k:
            votes -= w * FEWER_PENALTY / F32(info[q, COUNT])
        elif info[q, FREE] == 1 and info[q, MINE] == 0:
            votes += values[q, VOTE] * same
        if info[q, FREE] == 1 and same > ZERO:
            mine = q if info[q, MINE] == 1 else mine
            weight += w * same
            shift += w * same * e
            intensity += w * same * state[info[q, ROW], info[q, SURFACE], INTENSITY, info[q, COL]]
    at, intensity = values[c, AT] + shift / weight, intensity / weight
    if mine >= 0:
        at = values[mine, AT]
        intensity = state[info[mine, ROW], info[mine, SURFACE], INTENSITY, info[mine, COL]]
    return votes, at, intensity, mine


@line
def _best(k, least, unseen, i, j, found, values, info, state, rest, photons, exposure, bin_frequencies, period, total,
          max_response, background_table, moments):
    """The free candidate of the 3 × 3 neighbourhood with the highest log-likelihood ratio above `least`, or −1.

    And the ratio by the pixel's own photons, depth, which candidate is the pixel's own or −1, and photons from there.
    A candidate loses `unseen` nats times the probability that a pixel sees any of its photons.
    """
    best, most, own, at, mine, signal = -1, least, ZERO, ZERO, -1, ZERO
    close_by = 0                                    # candidates of the 3 × 3 neighbourhood so far, listed in info
    for c in range(found):
        if info[c, FREE] == 0 or abs(info[c, ROW] - i) > 1 or abs(info[c, COL] - j) > 1:
            continue
        judged = False                              # as one with a candidate before
        for q in range(close_by):
            same, _ = _agree(info[q, NEAR], c, values, period)
            if same > SAME_CANDIDATE:
                judged = True
                break
        info[close_by, NEAR] = c
        close_by += 1
        if judged:
            continue
        votes, where, intensity, its = _support(c, k, found, values, info, state, period)
        response = response_at(rest, 0, 1, bin_frequencies, where)
        likeness = SHARED_LIKENESS if k > 0 else LIKENESS
        ratio = llr(response, photons, intensity * exposure, likeness, total, max_response, background_table, moments)
        votes -= unseen * (ONE - np.exp(-intensity * exposure))
        if ratio + votes > most:
            best, most, own, at, mine = c, ratio + votes, ratio, where, its
            signal = max(response, ZERO) / total
    return best, own, at, mine, signal


@line
def _join(c, found, at, state, values, info, period, record):
    """Write the mean of the candidates that agree with c into `record`."""
    record[:] = ZERO
    weight = ZERO
    for q in range(found):
        same, _ = _agree(q, c, values, period)
        if info[q, FREE] == 1 and same > ZERO:
            w = values[q, WEIGHT] * same
            weight += w
            for f in range(len(record)):
                record[f] += w * state[info[q, ROW], info[q, SURFACE], f, info[q, COL]]
    for f in range(len(record)):
        record[f] /= weight
    record[DEPTH] = at - period * np.floor(at / period)
    record[SCORE] = ZERO                                            # for its pool to say


@parallel
def _update(matched, counts, exposure, energy, bin_frequencies, num_bins, max_response, background_table, moments,
            max_chi2, blur2, spreads, changed, before, own_before, after, own_after, changes, order):
    padded_rows, surfaces, fields, padded_cols = before.shape
    period, total = F32(num_bins), total_of(energy)
    most, max_std = (2 * VOTE_RADIUS + 1)**2 * surfaces, F32(MAX_STD) * period
    flat = before.reshape(-1)
    for turn in prange(padded_rows - 2 * MARGIN):
        i = order[turn] + MARGIN
        values, info = np.empty((most, 4), np.float32), np.empty((most, 7), np.int64)
        s = aligned(8 * BLOCK)
        rest, record = np.empty(2 * len(energy), np.float32), np.empty(fields, np.float32)
        for j in range(padded_cols):
            changes[i, j] = 0
        for k in range(surfaces):
            for f in range(fields):
                copy(before[i, k, f], after[i, k, f])
            copy(own_before[i, k], own_after[i, k])
        if spreads and not any_of(changed[i - VOTE_RADIUS:i + VOTE_RADIUS + 1]):
            continue
        for j in range(MARGIN, padded_cols - MARGIN):
            x = U(j - MARGIN) % B
            if x == 0:
                _find_undecided(s, flat, i * surfaces * fields * padded_cols + j, surfaces, U(padded_cols), max_chi2,
                                blur2, period, max_std)
            if s[OPEN + x] == ZERO or exposure[i, j] <= ZERO:
                continue
            around = changed[i - VOTE_RADIUS:i + VOTE_RADIUS + 1, j - VOTE_RADIUS:j + VOTE_RADIUS + 1]
            if spreads and (int(s[OWN + x]) == surfaces or not any_of(around)):
                continue
            found, had, blank, dark = _collect(i, j, before, own_before, counts, exposure, max_chi2, blur2, max_std,
                                               values, info)
            blank, dark = (ZERO, ZERO) if had > 0 else (EMPTY_PENALTY * blank, EMPTY_PENALTY * dark)
            copy(matched[i, :, j], rest)
            photons = counts[i, j]
            for k in range(surfaces):
                least = blank + BIRTH if k > 0 or had == 0 else NEVER
                c, own, at, mine, signal = _best(
                    k, least, dark, i, j, found, values, info, before, rest, photons, exposure[i, j],
                    bin_frequencies, period, total, max_response, background_table, moments)
                if c < 0:
                    changes[i, j] |= 1 if before[i, k, INTENSITY, j] > ZERO else 0
                    after[i, k, INTENSITY, j], own_after[i, k, j] = ZERO, ZERO
                    continue
                if mine >= 0:
                    copy(before[i, info[mine, SURFACE], :, j], record)
                else:
                    _join(c, found, at, before, values, info, period, record)
                changes[i, j] |= 1 if mine < 0 or info[mine, SURFACE] != k else 0
                copy(record, after[i, k, :, j])
                own_after[i, k, j] = own
                if k + 1 < surfaces:
                    photons = left(photons, signal)
                    subtract(rest, record[DEPTH], signal, energy, bin_frequencies)
                    for q in range(found):                          # what agrees is left out from now on
                        same, _ = _agree(q, c, values, period)
                        info[q, FREE] = 0 if same > ZERO else info[q, FREE]


def birth_death(frame, state, terms, max_chi2):
    """A step of spreading looks only where the last step has changed something: elsewhere it would decide as before."""
    # Depths nearer than the sketch can resolve are one surface's, whatever their standard deviations.
    blur2 = F32(RESOLVED * frame.resolution_bins)**2
    own = log_likelihood_ratio(frame, state, terms)
    order = fair_order(state.shape[0] - 2 * MARGIN, get_num_threads())
    changed, changes = (borrow(name, frame.counts.shape, True).view(np.int32)
                        for name in ("changed", "changes"))
    for step in range(1 + SPREAD):
        after = borrow(f"proposed {step % 2}", state.shape)
        own_after = borrow(f"own {step % 2}", own.shape)
        _update(frame.matched, frame.counts, frame.exposure, frame.energy, frame.bin_frequencies, frame.num_bins,
                F32(frame.max_response), frame.background_table, frame.intensity_moments, F32(max_chi2), blur2,
                step > 0, changed, state, own, after, own_after, changes, order)
        state, own, changed, changes = after, own_after, changes, changed
        if not changed.any():
            break
    return state
