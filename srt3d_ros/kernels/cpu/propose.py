"""Creation, competition and removal of points: a pixel's surfaces are chosen anew among its neighbourhood's."""

import numpy as np
from numba import prange

from srt3d_ros.core.layout import DEPTH, INTENSITY, MARGIN, SLOPE_COL, SLOPE_ROW, STD, WINDOW
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, TWO, ZERO, inline, parallel, sincos, wrap

PRIOR = F32(1)               # nats that a neighbour's vote is worth, at most
FILL_WINDOW = F32(2)         # pixels: window of a point that an empty pixel got from its neighbours
ENOUGH = 4                   # points of a 3 × 3 neighbourhood that carry a new or a second surface
NEAR = tuple(F32(np.exp(-d / (2 * 1.2**2))) for d in range(3))    # a vote's weight by squared distance

# Columns of the candidates' integer table.
ROW, COL, SURFACE, OWN, FREE = range(5)


@inline
def _candidates(i, j, state, gate, blur2, period, t, v, w, info):
    """Collect the surfaces of the 3 × 3 neighbourhood, carried to pixel (i, j) along their planes.

    Returns how many there are, how many are the pixel's own, and whether they are not all one surface.
    """
    found, own, differ = 0, 0, False
    for di in range(-1, 2):
        for dj in range(-1, 2):
            a, b = i + di, j + dj
            for k in range(state.shape[1]):
                if state[a, k, INTENSITY, b] > ZERO:
                    rise = state[a, k, SLOPE_COL, b] * F32(dj) + state[a, k, SLOPE_ROW, b] * F32(di)
                    t[found] = state[a, k, DEPTH, b] - rise
                    v[found] = gate * state[a, k, STD, b] * state[a, k, STD, b] + blur2
                    w[found] = NEAR[abs(di) + abs(dj)]
                    info[found, ROW], info[found, COL], info[found, SURFACE] = a, b, k
                    info[found, OWN] = 1 if di == 0 and dj == 0 else 0
                    info[found, FREE] = 1
                    own += info[found, OWN]
                    e = wrap(t[found] - t[0], period)
                    differ = differ or e * e > v[found] + v[0]
                    found += 1
    return found, own, differ


@inline
def _agreement(q, c, t, v, period):
    """How far two candidates are one surface, 0 … 1, and their difference in depth."""
    e = wrap(t[q] - t[c], period)
    return max(ONE - e * e / (v[q] + v[c]), ZERO), e


@inline
def _judge(c, found, t, v, w, info, rest, total, cycles, noise, period):
    """Evidence for candidate c: log-likelihood gain of the pixel's own photons, plus the neighbours' votes.

    Returns the evidence, the depth it holds for, how many candidates agree, and which of them is the pixel's own or −1.
    """
    votes, shift, count, mine = ZERO, ZERO, 0, -1
    for q in range(found):
        close, e = _agreement(q, c, t, v, period)
        if info[q, FREE] == 1 and close > ZERO:
            votes += w[q] * close
            shift += w[q] * close * e
            count += 1
            if info[q, OWN] == 1:
                mine = q
    at = t[mine] if mine >= 0 else t[c] + shift / votes
    value, m = ZERO, len(cycles)
    for l in range(m):
        sine, cosine = sincos(cycles[l] * at)
        value += rest[l] * cosine + rest[m + l] * sine
    value = max(value, ZERO)
    return value * value / (total * max(noise, ONE)) + PRIOR * votes, at, count, mine


@inline
def _join(c, found, at, state, t, v, w, info, period, record):
    """Spend the candidates that agree with c; write their mean, at depth `at`, into `record`."""
    record[:] = ZERO
    weight = ZERO
    for q in range(found):
        close, _ = _agreement(q, c, t, v, period)
        if info[q, FREE] == 1 and close > ZERO:
            info[q, FREE] = 0
            weight += w[q] * close
            for f in range(len(record)):
                record[f] += w[q] * close * state[info[q, ROW], info[q, SURFACE], f, info[q, COL]]
    for f in range(len(record)):
        record[f] /= weight
    record[DEPTH] = at - period * np.floor(at / period)


@inline
def _best(found, enough, t, v, w, info, rest, total, cycles, noise, period):
    """The free candidate with the most evidence among those that `enough` candidates agree on, or −1."""
    best, best_evidence, best_at, best_mine = -1, -ONE, ZERO, -1
    for c in range(found):
        if info[c, FREE] == 1:
            evidence, at, count, mine = _judge(c, found, t, v, w, info, rest, total, cycles, noise, period)
            if evidence > best_evidence and count >= enough:
                best, best_evidence, best_at, best_mine = c, evidence, at, mine
    return best, best_at, best_mine


@parallel
def _propose(matched, noise, exposure, energy, cycles, num_bins, gate, blur2, window, before, after):
    tall, surfaces, fields, wide = before.shape
    m = len(energy)
    period = F32(num_bins)
    total = energy.sum()
    most = 9 * surfaces
    for row in prange(tall - 2 * MARGIN):
        i = row + MARGIN
        t, v, w = np.empty(most, np.float32), np.empty(most, np.float32), np.empty(most, np.float32)
        info = np.empty((most, 5), np.int64)
        rest, record = np.empty(2 * m, np.float32), np.empty(fields, np.float32)
        for k in range(surfaces):
            after[i, k] = before[i, k]
            for j in range(MARGIN, wide - MARGIN):
                after[i, k, WINDOW, j] = max(before[i, k, WINDOW, j], window)
        for j in range(MARGIN, wide - MARGIN):
            if exposure[i, j] <= ZERO:
                continue
            found, own, differ = _candidates(i, j, before, gate, blur2, period, t, v, w, info)
            if (own > 0 and not differ) or (own == 0 and found < ENOUGH):
                continue
            rest[:] = matched[i, :, j]
            for k in range(surfaces):
                c, at, mine = _best(found, 1 if k == 0 else ENOUGH, t, v, w, info, rest, total, cycles, noise[i, j],
                                    period)
                if c < 0:
                    after[i, k, INTENSITY, j] = ZERO
                    continue
                _join(c, found, at, before, t, v, w, info, period, record)
                if mine >= 0:
                    record[:] = before[i, info[mine, SURFACE], :, j]
                    record[WINDOW] = max(record[WINDOW], window)
                else:
                    record[WINDOW] = window if own > 0 else max(window, FILL_WINDOW)
                after[i, k, :, j] = record
                for l in range(m):
                    sine, cosine = sincos(cycles[l] * record[DEPTH])
                    known = record[INTENSITY] * exposure[i, j] * energy[l]
                    rest[l] -= known * cosine
                    rest[m + l] -= known * sine


def propose(data, state, window, gate):
    """Let surfaces spread and compete: a pixel takes the neighbouring surface that its own photons speak for.

    A pixel without a surface gets one if four neighbours have it; a pixel at an edge chooses again between both sides;
    a second surface in a pixel stays only while four points of the neighbourhood carry it.

    Args:
        data: the frame (see `srt3d_ros.core.srt3d.Frame`).
        state: float32 [rows', K, FIELDS, cols'].
        window: σ of the neighbourhood that points pool from now on, at least, pixels.
        gate: as in `descend`.

    Returns:
        The next state.
    """
    after = np.zeros_like(state)
    # Depths nearer than the sketch can resolve are one surface, whatever their standard deviations.
    blur2 = (TWO * F32(data.resolution_bins))**2
    _propose(data.matched, data.noise, data.exposure, data.energy, data.cycles, data.num_bins, F32(gate), blur2,
             F32(window), state, after)
    return after
