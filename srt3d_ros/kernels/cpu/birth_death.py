"""Birth/death update: each pixel's surfaces are chosen anew among its neighbourhood's.

LANES of the pixels in which something is to be decided are judged together, in vector registers.
"""

import numpy as np
from numba import prange

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.constants import NEAR_SIGMA, SPREAD, VOTE_RADIUS
from srt3d_ros.kernels.cpu import field
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, TINY, ZERO, U, aligned, copy, sincos, total_of
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.field import agreement, is_surface, rise, wrap
from srt3d_ros.kernels.cpu.likelihood import LIKENESS, SHARED_LIKENESS, left, llr, log_likelihood_ratio, score_of
from srt3d_ros.kernels.cpu.undecided import mark_undecided
from srt3d_ros.kernels.maps import FIELDS, MAX_STD

BIRTH, EMPTY_PENALTY, MAX_VOTE, PRIOR_VOTE = (F32(getattr(constants, name)) for name in (
    "BIRTH", "EMPTY_PENALTY", "MAX_VOTE", "PRIOR_VOTE"))
NEVER = F32(-1e30)
SIDE = 2 * VOTE_RADIUS + 1
# A vote's weight by distance².
BY_DISTANCE = tuple(F32(np.exp(-d / (2 * NEAR_SIGMA**2))) for d in range(2 * VOTE_RADIUS**2 + 1))

LANES = 16
L = U(LANES)
# Offsets in a voter: a surface of the neighbourhood, carried to the pixel. WEIGHT is 0 if there is none, or none left;
# COUNT, of its pixel's surfaces, is in the first of them.
AT, TOLERANCE, LIGHT, WEIGHT, VOTE, COUNT = (U(k * LANES) for k in range(6))
VOTER = U(6 * LANES)
# Offsets in the scratch of `_judge`: of the pixel, of the candidate, of the best so far.
(PHOTONS, GAIN, LEAST, DARK, AGAINST, LIMIT, VOTES, SHIFT, SHARE, SIGNAL, PLACE, RATIO, MINE, RESPONSE,
 MOST, BEST, BEST_AT, BEST_RATIO, BEST_MINE, BEST_RESPONSE) = (U(k * LANES) for k in range(20))
SCRATCH = 20 * LANES


@line
def _gather(pixel, state, own, surfaces, padded_cols, max_chi2, blur2, max_std, v):
    """Write the voters of LANES pixels, place by place."""
    depth, ratio = np.empty(LANES, np.int64), np.empty(LANES, np.int64)         # of the pixels: where they are
    for x in range(L):
        row, col = pixel[x] // padded_cols * surfaces, pixel[x] % padded_cols
        depth[x], ratio[x] = row * FIELDS * padded_cols + col, row * padded_cols + col
    n = U(0)
    for di in range(-VOTE_RADIUS, VOTE_RADIUS + 1):
        for dj in range(-VOTE_RADIUS, VOTE_RADIUS + 1):
            weight, first = BY_DISTANCE[di * di + dj * dj], n
            votes = ZERO if di == 0 and dj == 0 else weight
            for x in range(L):
                v[first + COUNT + x] = ZERO
            for k in range(surfaces):
                row = (di * surfaces + k) * padded_cols
                for x in range(L):
                    here, cols = U(depth[x] + row * FIELDS + dj), U(padded_cols)
                    std, intensity = state[here + field.STD * cols], state[here + field.INTENSITY * cols]
                    there = ONE if is_surface(intensity, std, max_std) else ZERO
                    v[first + COUNT + x] += there
                    v[n + AT + x] = state[here] - rise(state[here + field.SLOPE_COL * cols],
                                                       state[here + field.SLOPE_ROW * cols], F32(dj), F32(di))
                    v[n + TOLERANCE + x] = max_chi2 * std * std + blur2
                    v[n + LIGHT + x] = intensity
                    v[n + WEIGHT + x] = there * weight
                    v[n + VOTE + x] = there * votes * min(max(PRIOR_VOTE + own[U(ratio[x] + row + dj)], ZERO), MAX_VOTE)
                n += VOTER


@inline
def _support(s, v, c, voters, middle, surfaces, period):
    """Votes (nats) for the candidate at c, the depth and intensity of what agrees, and which of the pixel's own."""
    for x in range(L):
        s[LIMIT + x] = v[c + TOLERANCE + x]
        s[VOTES + x], s[SHIFT + x], s[SHARE + x], s[SIGNAL + x], s[MINE + x] = ZERO, ZERO, ZERO, ZERO, -ONE
    for q in range(U(0), voters, VOTER):
        for x in range(L):
            e = wrap(v[q + AT + x] - v[c + AT + x], period)
            same = agreement(e, v[q + TOLERANCE + x] + s[LIMIT + x])
            w = same * v[q + WEIGHT + x]
            s[VOTES + x] += same * v[q + VOTE + x]
            s[SHARE + x] += w
            s[SHIFT + x] += w * e
            s[SIGNAL + x] += w * v[q + LIGHT + x]
    for x in range(L):
        share = max(s[SHARE + x], TINY)
        s[PLACE + x] = v[c + AT + x] + s[SHIFT + x] / share
        s[SIGNAL + x] /= share
    for k in range(U(surfaces)):
        q = middle + k * VOTER
        for x in range(L):
            e = wrap(v[q + AT + x] - v[c + AT + x], period)
            mine = (e * e < v[q + TOLERANCE + x] + s[LIMIT + x]) & (v[q + WEIGHT + x] > ZERO)
            s[MINE + x] = F32(k) if mine else s[MINE + x]
            s[PLACE + x] = v[q + AT + x] if mine else s[PLACE + x]
            s[SIGNAL + x] = v[q + LIGHT + x] if mine else s[SIGNAL + x]


@inline
def _respond(s, z, bin_frequencies):
    """The responses of the pixels' photons at the candidate's depths."""
    m = U(len(bin_frequencies))
    for x in range(L):
        s[RESPONSE + x] = ZERO
    for l in range(m):
        for x in range(L):
            sine, cosine = sincos(bin_frequencies[l] * s[PLACE + x])
            s[RESPONSE + x] += z[l * L + x] * cosine + z[(m + l) * L + x] * sine


@line
def _choose(k, s, v, z, voters, surfaces, bin_frequencies, period, total, max_response, background_table, moments):
    """Of the candidates, the surfaces of the 3 × 3 places in the middle, that with the highest log-likelihood ratio.

    It is the best as surface k if that is above what s has from MOST on. A candidate loses the nats from DARK on times
    the probability that a pixel sees any of its photons.
    """
    likeness, middle = SHARED_LIKENESS if k > 0 else LIKENESS, U(VOTE_RADIUS * (SIDE + 1) * surfaces) * VOTER
    any_dark = s[DARK:DARK + L].max() > ZERO
    for row in range(VOTE_RADIUS - 1, VOTE_RADIUS + 2):
        for place in range(row * SIDE + VOTE_RADIUS - 1, row * SIDE + VOTE_RADIUS + 2):
            for q in range(surfaces):
                c = U(place * surfaces + q) * VOTER
                if v[c + WEIGHT:c + WEIGHT + L].max() == ZERO:
                    continue
                _support(s, v, c, voters, middle, surfaces, period)
                _respond(s, z, bin_frequencies)
                for x in range(L):
                    s[RATIO + x] = score_of(s[RESPONSE + x], s[PHOTONS + x], max_response, background_table)
                for x in range(L):
                    s[RATIO + x] = llr(s[RATIO + x], s[RESPONSE + x], s[PHOTONS + x], s[SIGNAL + x] * s[GAIN + x],
                                       likeness, total, moments)
                for x in range(L if any_dark else U(0)):
                    s[VOTES + x] -= s[DARK + x] * (ONE - np.exp(-s[SIGNAL + x] * s[GAIN + x]))
                for x in range(L):
                    value = s[RATIO + x] + (s[VOTES + x] - s[AGAINST + x])
                    better = (v[c + WEIGHT + x] > ZERO) & (value > s[MOST + x])
                    s[MOST + x] = value if better else s[MOST + x]
                    s[BEST + x] = F32(c) if better else s[BEST + x]
                    for f in range(U(4)):           # place, ratio, own surface, response
                        now, best = s[PLACE + f * L + x], s[BEST_AT + f * L + x]
                        s[BEST_AT + f * L + x] = now if better else best


@line
def _oppose(k, s, v, surfaces):
    """Neighbours that have no more than k surfaces speak against one more, and no longer for any."""
    for x in range(L):
        s[AGAINST + x] = ZERO
    n = U(0)
    for di in range(-VOTE_RADIUS, VOTE_RADIUS + 1):
        for dj in range(-VOTE_RADIUS, VOTE_RADIUS + 1):
            weight = PRIOR_VOTE * BY_DISTANCE[di * di + dj * dj] if di != 0 or dj != 0 else ZERO
            for x in range(L):
                count = v[n + COUNT + x]
                s[AGAINST + x] += weight if (count > ZERO) & (count <= F32(k)) else ZERO
                for q in range(n, n + U(surfaces) * VOTER, VOTER):
                    v[q + VOTE + x] = ZERO if count <= F32(k) else v[q + VOTE + x]
            n += U(surfaces) * VOTER


@line
def _join(x, i, j, s, v, state, record, period):
    """Write the mean of the voters of lane x that agree with the best candidate into `record`."""
    surfaces, c = state.shape[1], U(s[BEST + x])
    record[:] = ZERO
    weight, q = ZERO, U(0)
    for di in range(-VOTE_RADIUS, VOTE_RADIUS + 1):
        for dj in range(-VOTE_RADIUS, VOTE_RADIUS + 1):
            for k in range(surfaces):
                e = wrap(v[q + AT + x] - v[c + AT + x], period)
                w = v[q + WEIGHT + x] * agreement(e, v[q + TOLERANCE + x] + v[c + TOLERANCE + x])
                if w > ZERO:
                    weight += w
                    for f in range(FIELDS):
                        record[f] += w * state[i + di, k, f, j + dj]
                q += VOTER
    for f in range(FIELDS):
        record[f] /= weight
    record[field.DEPTH] = s[BEST_AT + x] - period * np.floor(s[BEST_AT + x] / period)
    record[field.SCORE] = ZERO                                            # for its pool to say


@line
def _take(x, voters, s, v, z, energy, bin_frequencies, depth, total, period):
    """Take the best candidate's photons, and what agrees with it, out of lane x for the surfaces that follow."""
    m, c = U(len(energy)), U(s[BEST + x])
    at, limit, signal = v[c + AT + x], v[c + TOLERANCE + x], max(s[BEST_RESPONSE + x], ZERO) / total
    s[PHOTONS + x] = left(s[PHOTONS + x], signal)
    for l in range(m):
        sine, cosine = sincos(bin_frequencies[l] * depth)
        z[l * L + x] -= signal * energy[l] * cosine
        z[(m + l) * L + x] -= signal * energy[l] * sine
    for q in range(U(0), voters, VOTER):
        e = wrap(v[q + AT + x] - at, period)
        if e * e < v[q + TOLERANCE + x] + limit:
            v[q + WEIGHT + x], v[q + VOTE + x] = ZERO, ZERO


@line
def _load(pixel, matched, counts, exposure, surfaces, v, s, z):
    """Write what the pixels have seen, and what a surface needs: a first one more, by the places around without any."""
    padded_cols = counts.shape[1]
    for x in range(L):
        i, j = pixel[x] // padded_cols, pixel[x] % padded_cols
        s[PHOTONS + x], s[GAIN + x], s[AGAINST + x], blank, dark = counts[i, j], exposure[i, j], ZERO, ZERO, ZERO
        for c in range(matched.shape[1]):
            z[U(c) * L + x] = matched[i, c, j]
        had = v[U(VOTE_RADIUS * (SIDE + 1) * surfaces) * VOTER + COUNT + x] > ZERO
        for place in range(0 if had else SIDE * SIDE):
            di, dj = place // SIDE - VOTE_RADIUS, place % SIDE - VOTE_RADIUS
            if v[U(place * surfaces) * VOTER + COUNT + x] == ZERO and (di != 0 or dj != 0):
                if counts[i + di, j + dj] > ZERO:
                    blank += EMPTY_PENALTY * BY_DISTANCE[di * di + dj * dj]
                elif exposure[i + di, j + dj] > ZERO:
                    dark += EMPTY_PENALTY * BY_DISTANCE[di * di + dj * dj]
        s[DARK + x], s[LEAST + x] = dark, BIRTH + blank
        s[MOST + x] = NEVER if had else BIRTH + blank


@parallel
def _judge(undecided, matched, counts, exposure, energy, bin_frequencies, num_bins, max_response, background_table,
           moments, max_chi2, blur2, before, own_before, after, own_after, changes):
    _, surfaces, fields, padded_cols = before.shape
    period, total, max_std = F32(num_bins), total_of(energy), F32(MAX_STD) * F32(num_bins)
    voters = U(SIDE * SIDE * surfaces) * VOTER
    state, own = before.reshape(-1), own_before.reshape(-1)
    for part in prange(-(-len(undecided) // LANES)):
        first, several = part * LANES, min(LANES, len(undecided) - part * LANES)
        pixel, record = np.empty(LANES, np.int64), np.empty(fields, np.float32)
        for x in range(LANES):                  # a last part has more of its last pixel, whose results nobody takes
            pixel[x] = undecided[first + min(x, several - 1)]
        s, v, z = aligned(SCRATCH), aligned(int(voters)), aligned(2 * len(energy) * LANES)
        _gather(pixel, state, own, surfaces, padded_cols, max_chi2, blur2, max_std, v)
        _load(pixel, matched, counts, exposure, surfaces, v, s, z)
        for k in range(surfaces):
            for x in range(L):
                s[MOST + x] = s[LEAST + x] if k > 0 else s[MOST + x]
                s[BEST + x] = -ONE
            if k > 0:
                _oppose(k, s, v, surfaces)
            _choose(k, s, v, z, voters, surfaces, bin_frequencies, period, total, max_response, background_table,
                    moments)
            for x in range(U(several)):
                i, j, mine = pixel[x] // padded_cols, pixel[x] % padded_cols, int(s[BEST_MINE + x])
                if s[BEST + x] < ZERO:
                    changes[i, j] |= 1 if before[i, k, field.INTENSITY, j] > ZERO else 0
                    after[i, k, field.INTENSITY, j], own_after[i, k, j] = ZERO, ZERO
                    continue
                if mine >= 0:
                    copy(before[i, mine, :, j], record)
                else:
                    _join(x, i, j, s, v, before, record, period)
                changes[i, j] |= 1 if mine != k else 0
                copy(record, after[i, k, :, j])
                own_after[i, k, j] = s[BEST_RATIO + x]
                if k + 1 < surfaces:
                    _take(x, voters, s, v, z, energy, bin_frequencies, record[field.DEPTH], total, period)


def birth_death(frame, state, terms, max_chi2):
    """A step of spreading looks only where the last step has changed something: elsewhere it would decide as before."""
    # Depths within the width of a matched filter's peak are one surface's, whatever their standard deviations.
    max_chi2, blur2, period = F32(max_chi2), F32(frame.resolution_bins)**2, F32(frame.num_bins)
    own = log_likelihood_ratio(frame, state, terms)
    changed, changes = (borrow(name, frame.counts.shape, True).view(np.int32) for name in ("changed", "changes"))
    undecided = np.zeros(frame.counts.shape, np.bool_)
    for step in range(1 + SPREAD):
        after, own_after = borrow(f"proposed {step % 2}", state.shape), borrow(f"own {step % 2}", own.shape)
        mark_undecided(frame.exposure, step > 0, changed, state, own, after, own_after, changes, max_chi2, blur2,
                       period, F32(MAX_STD) * period, undecided)
        _judge(np.flatnonzero(undecided), frame.matched, frame.counts, frame.exposure, frame.energy,
               frame.bin_frequencies, frame.num_bins, F32(frame.max_response), frame.background_table,
               frame.intensity_moments, max_chi2, blur2, state, own, after, own_after, changes)
        state, own, changed, changes = after, own_after, changes, changed
        if not changed.any():
            break
    return state
