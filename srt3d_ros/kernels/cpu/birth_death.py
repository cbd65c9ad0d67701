"""Birth/death update: each pixel's surfaces are chosen anew among its neighbourhood's.

LANES of a row's pixels in which something is to be decided are judged together, in vector registers. What they need
lies in flat scratch arrays, at offsets known when compiling (`pooled_step`).
"""

import numpy as np
from numba import prange

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.constants import SPREAD
from srt3d_ros.kernels.cpu import field
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, TINY, ZERO, U, aligned, sincos
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.field import agreement, is_surface, rise, wrap
from srt3d_ros.kernels.cpu.frame import as_compiled
from srt3d_ros.kernels.cpu.likelihood import LIKENESS, SHARED_LIKENESS, left, llr, score_of
from srt3d_ros.kernels.cpu.undecided import list_undecided
from srt3d_ros.kernels.maps import FIELDS, INTENSITY, MARGIN

VOTE, EMPTY_VOTE = F32(constants.VOTE), F32(constants.EMPTY_SHARE * constants.VOTE)
NEVER = F32(-1e30)
PLACES, MIDDLE = 9, 4           # of the 3 × 3 neighbourhood, row by row; the pixel's own

LANES = 16
L = U(LANES)
# Offsets in a voter: a surface of the neighbourhood, carried to the pixel. FREE is 0 if there is none, or none left.
AT, TOLERANCE, LIGHT, FREE, VOTES = (U(k * LANES) for k in range(5))
VOTER = U(5 * LANES)
# Offsets in the scratch of `_judge`: of the pixel, of the candidate, of the best so far, and for each place how many
# surfaces it has, −1 if it is not used.
(PHOTONS, GAIN, AGAINST, LIMIT, FOR, SHIFT, SHARE, SIGNAL, RATIO, PLACE, MINE, RESPONSE,
 MOST, BEST, BEST_PLACE, BEST_MINE, BEST_RESPONSE, COUNT) = (U(k * LANES) for k in range(18))
SCRATCH = (17 + PLACES) * LANES


@line
def _gather(i, cols, frame, state, surfaces, max_chi2, v, s, z):
    """Write the voters of some pixels of row i, place by place, how many each place has, and what the pixels saw."""
    padded_cols, blur2 = frame.counts.shape[1], frame.resolution * frame.resolution
    width, pixel = U(padded_cols), np.empty(LANES, np.int64)
    for x in range(LANES):                      # further lanes have the last pixel, and nobody takes what they find
        pixel[x] = cols[min(x, len(cols) - 1)]
    for x in range(L):
        s[PHOTONS + x], s[GAIN + x] = frame.counts[i, pixel[x]], frame.exposure[i, pixel[x]]
        for c in range(frame.matched.shape[1]):
            z[U(c) * L + x] = frame.matched[i, c, pixel[x]]
    n = U(0)
    for place in range(PLACES):
        row, dj, count = i + place // 3 - 1, place % 3 - 1, COUNT + U(place) * L
        for x in range(L):
            s[count + x] = ZERO if frame.exposure[row, pixel[x] + dj] > ZERO else -ONE
        for k in range(surfaces):
            first = (row * surfaces + k) * FIELDS * padded_cols + dj
            for x in range(L):
                here = U(first + pixel[x])
                std, intensity = state[here + field.STD * width], state[here + field.INTENSITY * width]
                there = ONE if is_surface(intensity, std, frame.max_std) else ZERO
                s[count + x] += there
                v[n + AT + x] = state[here] - rise(state[here + field.SLOPE_COL * width],
                                                   state[here + field.SLOPE_ROW * width], F32(dj), F32(row - i))
                v[n + TOLERANCE + x] = max_chi2 * std * std + blur2
                v[n + LIGHT + x] = intensity
                v[n + FREE + x] = there
            n += VOTER


@line
def _begin(k, s, v, surfaces):
    """Empty the best; places that have no more than k surfaces speak against surface k, the others vote for theirs."""
    for x in range(L):
        keeps = (k == 0) & (s[COUNT + U(MIDDLE) * L + x] > ZERO)
        s[MOST + x], s[BEST + x], s[AGAINST + x] = NEVER if keeps else ZERO, -ONE, ZERO
    for place in range(PLACES):
        number, first = COUNT + U(place) * L, U(place * surfaces) * VOTER
        for x in range(L):
            count = s[number + x]
            fewer = (count >= ZERO) & (count <= F32(k)) & (place != MIDDLE)
            s[AGAINST + x] += (VOTE if count > ZERO else EMPTY_VOTE) if fewer else ZERO
            for q in range(first, first + U(surfaces) * VOTER, VOTER):
                v[q + VOTES + x] = VOTE if (count > F32(k)) & (place != MIDDLE) else ZERO


@inline
def _support(s, v, c, voters, surfaces, period):
    """Votes (nats) for the candidate at c, the depth and intensity of what agrees, and which of the pixel's own."""
    for x in range(L):
        s[LIMIT + x] = v[c + TOLERANCE + x]
        s[FOR + x], s[SHIFT + x], s[SHARE + x], s[SIGNAL + x], s[MINE + x] = ZERO, ZERO, ZERO, ZERO, -ONE
    for q in range(U(0), voters, VOTER):
        for x in range(L):
            e = wrap(v[q + AT + x] - v[c + AT + x], period)
            w = v[q + FREE + x] * agreement(e, v[q + TOLERANCE + x] + s[LIMIT + x])
            s[FOR + x] += w * v[q + VOTES + x]
            s[SHARE + x] += w
            s[SHIFT + x] += w * e
            s[SIGNAL + x] += w * v[q + LIGHT + x]
    for x in range(L):
        share = max(s[SHARE + x], TINY)
        s[PLACE + x] = v[c + AT + x] + s[SHIFT + x] / share
        s[SIGNAL + x] /= share
    for k in range(U(surfaces)):
        q = (U(MIDDLE * surfaces) + k) * VOTER
        for x in range(L):
            e = wrap(v[q + AT + x] - v[c + AT + x], period)
            mine = (e * e < v[q + TOLERANCE + x] + s[LIMIT + x]) & (v[q + FREE + x] > ZERO)
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
def _choose(k, s, v, z, voters, surfaces, frame):
    """Of the surfaces around, that with the highest log-likelihood ratio, if that is above what s has from MOST on."""
    likeness = SHARED_LIKENESS if k > 0 else LIKENESS
    for c in range(U(0), voters, VOTER):
        if v[c + FREE:c + FREE + L].max() == ZERO:
            continue
        _support(s, v, c, voters, surfaces, frame.period)
        _respond(s, z, frame.bin_frequencies)
        for x in range(L):
            s[RATIO + x] = score_of(s[RESPONSE + x], s[PHOTONS + x], frame)
        for x in range(L):
            s[RATIO + x] = llr(s[RATIO + x], s[RESPONSE + x], s[PHOTONS + x], s[SIGNAL + x] * s[GAIN + x], likeness,
                               frame)
        for x in range(L):
            value = s[RATIO + x] + (s[FOR + x] - s[AGAINST + x])
            better = (v[c + FREE + x] > ZERO) & (value > s[MOST + x])
            s[MOST + x] = value if better else s[MOST + x]
            s[BEST + x] = F32(c) if better else s[BEST + x]
            for f in range(U(3)):           # place, own surface, response
                now, best = s[PLACE + f * L + x], s[BEST_PLACE + f * L + x]
                s[BEST_PLACE + f * L + x] = now if better else best


@line
def _join(x, i, j, s, v, state, record, period):
    """Write the mean of the voters of lane x, pixel (i, j), that agree with the best candidate into `record`."""
    surfaces, c = state.shape[1], U(s[BEST + x])
    record[:] = ZERO
    weight, q = ZERO, U(0)
    for place in range(PLACES):
        row, col = i + place // 3 - 1, j + place % 3 - 1
        for k in range(surfaces):
            e = wrap(v[q + AT + x] - v[c + AT + x], period)
            w = v[q + FREE + x] * agreement(e, v[q + TOLERANCE + x] + v[c + TOLERANCE + x])
            if w > ZERO:
                weight += w
                for f in range(FIELDS):
                    record[f] += w * state[row, k, f, col]
            q += VOTER
    for f in range(FIELDS):
        record[f] /= weight
    record[field.DEPTH] = s[BEST_PLACE + x] - period * np.floor(s[BEST_PLACE + x] / period)
    record[field.SCORE] = ZERO                                            # for its pool to say


@line
def _take(x, depth, voters, s, v, z, frame):
    """Take the best candidate's photons, and what agrees with it, out of lane x for the surfaces that follow."""
    m, c = U(len(frame.energy)), U(s[BEST + x])
    at, limit, signal = v[c + AT + x], v[c + TOLERANCE + x], max(s[BEST_RESPONSE + x], ZERO) / frame.total_energy
    s[PHOTONS + x] = left(s[PHOTONS + x], signal)
    for l in range(m):
        sine, cosine = sincos(frame.bin_frequencies[l] * depth)
        z[l * L + x] -= signal * frame.energy[l] * cosine
        z[(m + l) * L + x] -= signal * frame.energy[l] * sine
    for q in range(U(0), voters, VOTER):
        e = wrap(v[q + AT + x] - at, frame.period)
        if e * e < v[q + TOLERANCE + x] + limit:
            v[q + FREE + x] = ZERO


@line
def _judge(i, cols, frame, state, max_chi2, v, s, z, points, changed):
    """Write the points that up to LANES pixels of row i choose, instead of their own, and mark those that change."""
    surfaces = state.shape[1]
    voters = U(PLACES * surfaces) * VOTER
    _gather(i, cols, frame, state.reshape(-1), surfaces, max_chi2, v, s, z)
    for k in range(surfaces):
        _begin(k, s, v, surfaces)
        _choose(k, s, v, z, voters, surfaces, frame)
        for x in range(len(cols)):
            j, lane, point = cols[x], U(x), points[x, k]
            for f in range(FIELDS):
                point[f] = state[i, k, f, j]
            if s[BEST + lane] < ZERO:
                changed[i, j] |= point[INTENSITY] > ZERO
                point[INTENSITY] = ZERO
                continue
            mine = int(s[BEST_MINE + lane])
            changed[i, j] |= mine != k
            if mine < 0:
                _join(lane, i, j, s, v, state, point, frame.period)
            elif mine != k:
                for f in range(FIELDS):
                    point[f] = state[i, mine, f, j]
            if k + 1 < surfaces:
                _take(lane, point[field.DEPTH], voters, s, v, z, frame)


@parallel
def _decide(frame, state, max_chi2, near, grows, cols, number, points, changed):
    """List the undecided pixels of each row: their columns, their number, and the points that they choose."""
    padded_rows, surfaces, _, padded_cols = state.shape
    for turn in prange(padded_rows - 2 * MARGIN):
        i = turn + MARGIN
        number[i] = list_undecided(i, frame, state, max_chi2, near, grows, cols[i])
        if number[i] > 0:
            s, z = aligned(SCRATCH), aligned(2 * len(frame.energy) * LANES)
            v = aligned(PLACES * surfaces * int(VOTER))
            for first in range(0, number[i], LANES):
                last = min(first + LANES, number[i])
                _judge(i, cols[i, first:last], frame, state, max_chi2, v, s, z, points[i, first:last], changed)


@parallel
def _write(cols, number, points, state):
    for i in prange(len(state)):
        for n in range(number[i]):
            state[i, :, :, cols[i, n]] = points[i, n]


def birth_death(frame, state, max_chi2):
    """A further step looks only beside what the last one has changed: elsewhere it would decide as before."""
    padded_rows, surfaces, fields, padded_cols = state.shape
    compiled, changed, grows = as_compiled(frame), np.ones(frame.counts.shape, bool), False
    cols, number = np.empty(changed.shape, np.int32), np.zeros(padded_rows, np.int64)
    points = borrow("chosen", (padded_rows, padded_cols, surfaces, fields))
    for _ in range(1 + SPREAD):
        near, changed = changed, np.zeros_like(changed)
        _decide(compiled, state, F32(max_chi2), near, grows, cols, number, points, changed)
        _write(cols, number, points, state)
        grows = True
        if not changed.any():
            break
    return state
