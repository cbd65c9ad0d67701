"""Birth/death update: each pixel's surfaces are chosen anew among its neighbourhood's.

LANES of the pixels in which something is to be decided are judged together, in vector registers. What they need lies in
flat scratch arrays, at offsets known when compiling (`pooled_step`).
"""

import numpy as np
from numba import boolean, float32, int32, int64, prange

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.constants import NEAR_SIGMA, SPREAD, VOTE_RADIUS
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, TINY, ZERO, U, aligned, sincos
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel, serial
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.method import field
from srt3d_ros.kernels.cpu.method.field import agreement, is_surface, rise, wrap
from srt3d_ros.kernels.cpu.method.frame import FRAME, as_compiled
from srt3d_ros.kernels.cpu.method.likelihood import LIKENESS, SHARED_LIKENESS, left, llr, log_likelihood_ratio, score_of
from srt3d_ros.kernels.cpu.method.undecided import list_undecided
from srt3d_ros.kernels.maps import FIELDS, INTENSITY

VOTE, MAX_VOTE, EMPTY_VOTE = (F32(votes * constants.VOTE) for votes in (1, constants.MAX_VOTES, constants.EMPTY_VOTES))
NEVER = F32(-1e30)
SIDE = 2 * VOTE_RADIUS + 1
PLACES, MIDDLE = SIDE * SIDE, VOTE_RADIUS * (SIDE + 1)
# Of each place of the neighbourhood: the weight of its surfaces, and that of their votes.
ROW, COL = np.indices((SIDE, SIDE)).reshape(2, -1) - VOTE_RADIUS
WEIGHTS = np.exp(-(ROW**2 + COL**2) / (2 * NEAR_SIGMA**2)).astype(np.float32)
VOTING = np.where(np.arange(PLACES) == MIDDLE, ZERO, WEIGHTS)
CLOSE_BY = tuple(MIDDLE + row * SIDE + col for row in (-1, 0, 1) for col in (-1, 0, 1))

LANES = 16
L = U(LANES)
# Offsets in a voter: a surface of the neighbourhood, carried to the pixel. WEIGHT is 0 if there is none, or none left;
# COUNT, of its pixel's surfaces, is in the first of them.
AT, TOLERANCE, LIGHT, WEIGHT, ADDS, COUNT = (U(k * LANES) for k in range(6))
VOTER = U(6 * LANES)
# Offsets in the scratch of `_judge`: of the pixel, of the candidate, of the best so far.
(PHOTONS, GAIN, LEAST, DARK, AGAINST, LIMIT, VOTES, SHIFT, SHARE, SIGNAL, PLACE, RATIO, MINE, RESPONSE,
 MOST, BEST, BEST_AT, BEST_RATIO, BEST_MINE, BEST_RESPONSE) = (U(k * LANES) for k in range(20))
SCRATCH = 20 * LANES


@line
def _gather(pixel, frame, state, own, surfaces, max_chi2, v, s, z):
    """Write the voters of LANES pixels, place by place, what the pixels have seen, and what a surface needs.

    A first one needs more, by the places around without any.
    """
    padded_cols, counts, exposure = frame.counts.shape[1], frame.counts.reshape(-1), frame.exposure.reshape(-1)
    cols, blur2, m = U(padded_cols), frame.resolution * frame.resolution, frame.matched.shape[1]
    depth, ratio = np.empty(LANES, np.int64), np.empty(LANES, np.int64)         # of the pixels: where they are
    for x in range(L):
        row, col = pixel[x] // padded_cols, pixel[x] % padded_cols
        depth[x], ratio[x] = row * surfaces * FIELDS * padded_cols + col, row * surfaces * padded_cols + col
        s[PHOTONS + x], s[GAIN + x], s[LEAST + x], s[DARK + x] = counts[pixel[x]], exposure[pixel[x]], VOTE, ZERO
        for c in range(m):
            z[U(c) * L + x] = frame.matched[row, c, col]
    n = U(0)
    for place in range(PLACES):
        di, dj, first = place // SIDE - VOTE_RADIUS, place % SIDE - VOTE_RADIUS, n
        for x in range(L):
            v[first + COUNT + x] = ZERO
        for k in range(surfaces):
            row = (di * surfaces + k) * padded_cols
            for x in range(L):
                here = U(depth[x] + row * FIELDS + dj)
                std, intensity = state[here + field.STD * cols], state[here + field.INTENSITY * cols]
                there = ONE if is_surface(intensity, std, frame.max_std) else ZERO
                v[first + COUNT + x] += there
                v[n + AT + x] = state[here] - rise(state[here + field.SLOPE_COL * cols],
                                                   state[here + field.SLOPE_ROW * cols], F32(dj), F32(di))
                v[n + TOLERANCE + x] = max_chi2 * std * std + blur2
                v[n + LIGHT + x] = intensity
                v[n + WEIGHT + x] = there * WEIGHTS[place]
                vote = min(max(VOTE + own[U(ratio[x] + row + dj)], ZERO), MAX_VOTE)
                v[n + ADDS + x] = there * VOTING[place] * vote
            n += VOTER
        for x in range(L):
            there = pixel[x] + di * padded_cols + dj
            gap = EMPTY_VOTE * VOTING[place] if v[first + COUNT + x] == ZERO else ZERO
            s[LEAST + x] += gap if counts[there] > ZERO else ZERO
            s[DARK + x] += gap if (counts[there] <= ZERO) & (exposure[there] > ZERO) else ZERO
    for x in range(L):
        had = v[U(MIDDLE * surfaces) * VOTER + COUNT + x] > ZERO
        s[MOST + x] = NEVER if had else s[LEAST + x]
        s[LEAST + x] = VOTE if had else s[LEAST + x]
        s[DARK + x], s[AGAINST + x], s[BEST + x] = ZERO if had else s[DARK + x], ZERO, -ONE


@inline
def _support(s, v, c, voters, surfaces, period):
    """Votes (nats) for the candidate at c, the depth and intensity of what agrees, and which of the pixel's own."""
    for x in range(L):
        s[LIMIT + x] = v[c + TOLERANCE + x]
        s[VOTES + x], s[SHIFT + x], s[SHARE + x], s[SIGNAL + x], s[MINE + x] = ZERO, ZERO, ZERO, ZERO, -ONE
    for q in range(U(0), voters, VOTER):
        for x in range(L):
            e = wrap(v[q + AT + x] - v[c + AT + x], period)
            same = agreement(e, v[q + TOLERANCE + x] + s[LIMIT + x])
            w = same * v[q + WEIGHT + x]
            s[VOTES + x] += same * v[q + ADDS + x]
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
def _choose(k, s, v, z, voters, surfaces, frame):
    """Of the candidates, the surfaces of the 3 × 3 places in the middle, that with the highest log-likelihood ratio.

    It is the best as surface k if that is above what s has from MOST on. A candidate loses the nats from DARK on times
    the probability that a pixel sees any of its photons.
    """
    likeness, any_dark = SHARED_LIKENESS if k > 0 else LIKENESS, s[DARK:DARK + L].max() > ZERO
    for place in CLOSE_BY:
        for q in range(surfaces):
            c = U(place * surfaces + q) * VOTER
            if v[c + WEIGHT:c + WEIGHT + L].max() == ZERO:
                continue
            _support(s, v, c, voters, surfaces, frame.period)
            _respond(s, z, frame.bin_frequencies)
            for x in range(L):
                s[RATIO + x] = score_of(s[RESPONSE + x], s[PHOTONS + x], frame)
            for x in range(L):
                s[RATIO + x] = llr(s[RATIO + x], s[RESPONSE + x], s[PHOTONS + x], s[SIGNAL + x] * s[GAIN + x], likeness,
                                   frame)
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
def _begin_further(k, s, v, surfaces):
    """Neighbours with no more than k surfaces speak against one more, unless they show it, and no longer for any."""
    for x in range(L):
        s[MOST + x], s[BEST + x], s[AGAINST + x] = s[LEAST + x], -ONE, ZERO
    for place in range(PLACES):
        first = U(place * surfaces) * VOTER
        for x in range(L):
            count = v[first + COUNT + x]
            s[AGAINST + x] += VOTE * VOTING[place] if (count > ZERO) & (count <= F32(k)) else ZERO
            for q in range(first, first + U(surfaces) * VOTER, VOTER):
                shown = VOTE * VOTING[place] if v[q + WEIGHT + x] > ZERO else ZERO
                v[q + ADDS + x] = shown if count <= F32(k) else v[q + ADDS + x]


@line
def _join(x, i, j, s, v, state, record, period):
    """Write the mean of the voters of lane x, pixel (i, j), that agree with the best candidate into `record`."""
    surfaces, c = state.shape[1], U(s[BEST + x])
    record[:] = ZERO
    weight, q = ZERO, U(0)
    for place in range(PLACES):
        row, col = i + place // SIDE - VOTE_RADIUS, j + place % SIDE - VOTE_RADIUS
        for k in range(surfaces):
            e = wrap(v[q + AT + x] - v[c + AT + x], period)
            w = v[q + WEIGHT + x] * agreement(e, v[q + TOLERANCE + x] + v[c + TOLERANCE + x])
            if w > ZERO:
                weight += w
                for f in range(FIELDS):
                    record[f] += w * state[row, k, f, col]
            q += VOTER
    for f in range(FIELDS):
        record[f] /= weight
    record[field.DEPTH] = s[BEST_AT + x] - period * np.floor(s[BEST_AT + x] / period)
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
            v[q + WEIGHT + x], v[q + ADDS + x] = ZERO, ZERO


@parallel
def _judge(pixels: int32[::1], number: int64, frame: FRAME, state: float32[:, :, :, ::1], own: float32[:, :, ::1],
           max_chi2: float32, points: float32[:, :, ::1], ratios: float32[:, ::1], near: boolean[:, ::1]):
    """Write what `number` pixels choose, points [N, K, FIELDS] and ratios [N, K], and what is near a change."""
    surfaces, cols = state.shape[1], state.shape[3]
    voters = U(PLACES * surfaces) * VOTER
    for part in prange(-(-number // LANES)):
        first = part * LANES
        pixel = np.empty(LANES, np.int64)
        for x in range(LANES):                  # a last part has more of its last pixel, whose results nobody takes
            pixel[x] = pixels[min(first + x, number - 1)]
        s, v, z = aligned(SCRATCH), aligned(int(voters)), aligned(2 * len(frame.energy) * LANES)
        _gather(pixel, frame, state.reshape(-1), own.reshape(-1), surfaces, max_chi2, v, s, z)
        for k in range(surfaces):
            if k > 0:
                _begin_further(k, s, v, surfaces)
            _choose(k, s, v, z, voters, surfaces, frame)
            for x in range(min(LANES, number - first)):
                lane, i, j, point = U(x), pixel[x] // cols, pixel[x] % cols, points[first + x, k]
                found, mine = s[BEST + lane] >= ZERO, int(s[BEST_MINE + lane])
                if mine != k if found else state[i, k, INTENSITY, j] > ZERO:
                    near[i - VOTE_RADIUS:i + VOTE_RADIUS + 1, j - VOTE_RADIUS:j + VOTE_RADIUS + 1] = True
                if not found:
                    point[INTENSITY], ratios[first + x, k] = ZERO, own[i, k, j]
                    continue
                ratios[first + x, k] = s[BEST_RATIO + lane]
                if mine < 0:
                    _join(lane, i, j, s, v, state, point, frame.period)
                else:
                    for f in range(FIELDS):
                        point[f] = state[i, mine, f, j]
                if k + 1 < surfaces:
                    _take(lane, point[field.DEPTH], voters, s, v, z, frame)


@serial
def _write(pixels: int32[::1], number: int64, points: float32[:, :, ::1], ratios: float32[:, ::1],
           state: float32[:, :, :, ::1], own: float32[:, :, ::1]):
    for n in range(number):
        i, j = pixels[n] // state.shape[3], pixels[n] % state.shape[3]
        for k in range(state.shape[1]):
            own[i, k, j] = ratios[n, k]
            for f in range(FIELDS):
                state[i, k, f, j] = points[n, k, f]


def birth_death(frame, state, terms, max_chi2):
    """A step of spreading looks only where the last step has changed something: elsewhere it would decide as before."""
    own, compiled, size = log_likelihood_ratio(frame, state, terms), as_compiled(frame), frame.counts.size
    points, ratios = borrow("chosen", (size, *state.shape[1:3])), borrow("chosen ratios", (size, state.shape[1]))
    near = np.ones(frame.counts.shape, bool)
    for spreads in range(1 + SPREAD):
        pixels, number = list_undecided(compiled, state, F32(max_chi2), near, spreads > 0)
        near[:] = False
        _judge(pixels, number, compiled, state, own, F32(max_chi2), points, ratios, near)
        _write(pixels, number, points, ratios, state, own)
        if not near.any():
            break
    return state
