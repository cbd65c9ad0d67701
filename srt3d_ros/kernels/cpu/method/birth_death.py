"""Birth/death update: each pixel takes the neighbouring surfaces with the highest log-likelihood ratio, or none.

The surfaces q in the square of VOTE_RADIUS vote, but not the pixel's own. Each is carried to the pixel along its plane,
to t_q − slopes · offset, and may be off by v_q = max_chi2 · std² + min(δ, Δ / 2)², Δ: to the pixel's next surface. A
candidate c is one of those of the 3 × 3 pixels in the middle. It agrees with q by a_qc = (1 − e² / (v_q + v_c))₊, where
e = wrap(t_q − t_c). Its depth and intensity are those of the pixel's own surface that agrees, else the means of all
that agree, weighted by w_q a_qc with w = exp(−distance² / 2 NEAR_SIGMA²).
The pixel's surface k is the candidate with the highest

    ratio of the pixel's photons + Σ_q w_q a_qc clip(VOTE + ratio_q, 0, MAX_VOTES · VOTE)
        − Σ FEWER_COST w (k > 0: neighbours with a surface, but no more than k; these vote w a FEWER_COST)
        − Σ EMPTY_VOTES · VOTE · w · (1 − exp(−g r)) (no surface yet: used neighbours with neither surface nor photons)

if that is above what it needs: BIRTH_COST, and EMPTY_VOTES · VOTE · w more for each neighbour that has photons but no
surface; nothing for the first surface of a pixel that has one. Then the photons that it explains, and the surfaces that
agree with it, are left out, and the next one is chosen. `kernels.torch` has the notation and all rules.

The pixels in which something is to be decided (`list_row`) are listed, and each vector holds LANES of them.
"""

from typing import NamedTuple

import numba
import numpy as np
from numba import boolean, float32, int32, prange

from srt3d_ros.kernels.constants import SPREAD, VOTE_RADIUS
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO, exp
from srt3d_ros.kernels.cpu.compiling import floats2d, floats3d, floats4d, line, parallel
from srt3d_ros.kernels.cpu.method.drops import drop_ghosts, refuse_growth
from srt3d_ros.kernels.cpu.method.frame import Frame, Point, point_at, response_at, without
from srt3d_ros.kernels.cpu.method.likelihood import LIKENESS, SHARED_LIKENESS, left, llr, log_likelihood_ratio
from srt3d_ros.kernels.cpu.method.sketches import expand_stale
from srt3d_ros.kernels.cpu.method.voters import (
    BIRTH_COST,
    COUNT,
    MIDDLE,
    SAYS,
    SIDE,
    WEIGHT,
    agrees,
    gather_voters,
    join_rows,
    list_row,
    mean_of,
    speak_against,
    support,
    voter_at,
)
from srt3d_ros.kernels.cpu.vectors import floats, floor, full, lanes_of, load, store, where
from srt3d_ros.kernels.maps import FIELDS, INTENSITY, LANES, MARGIN

ALWAYS = F32(-1e30)         # what a pixel's first surface needs if it has one: less than any has
CLOSE_BY = tuple(MIDDLE + row * SIDE + col for row in (-1, 0, 1) for col in (-1, 0, 1))     # places of candidates


class Lists(NamedTuple):
    """The columns of the undecided pixels of each row, how many they are, and rows and columns of all, [2, N]."""

    columns: int32[:, ::1]
    numbers: int32[::1]
    listed: int32[:, ::1]


class Chosen(NamedTuple):
    """What the listed pixels have chosen.

    Points [K, FIELDS, N], ratios [K, N], 1 near a change, a map, and which vectors of pixels have changed.
    """

    points: floats3d
    ratios: floats2d
    near: floats2d
    stale: boolean[:, ::1]


class Scratch(NamedTuple):
    """Memory of each thread: the voters of LANES pixels, and what the surfaces found leave of their sketches."""

    voters: floats4d        # [threads, PLACES · K, fields of a Voter, LANES]
    rest: floats3d          # [threads, 2m, LANES]


class Seen(NamedTuple):
    """What the pixels have seen, and what a surface of theirs needs, nats."""

    photons: floats         # those that the surfaces found leave
    exposure: floats
    needed: floats          # what it must exceed
    dark: floats            # what it loses for used neighbours without photons, times 1 − exp(−g r)
    against: floats         # and for neighbours with fewer surfaces


class Best(NamedTuple):
    """The best candidates so far."""

    value: floats           # ratio and votes, nats
    depth: floats           # where the candidate lies
    tolerance: floats       # its v
    new_depth: floats       # of the surface that it makes, and its intensity
    intensity: floats
    own: floats             # which of the pixel's own surfaces it is; −1: none
    response: floats
    ratio: floats


@line
def _choose(k, seen, voters, rest, surfaces, frame):
    """The candidates with the highest log-likelihood ratio as surface k, and whether it is above what is needed."""
    likeness, any_dark, found = SHARED_LIKENESS if k > 0 else LIKENESS, lanes_of(seen.dark > 0) != 0, full(False)
    nothing = full(ZERO)
    best = Best(seen.needed, nothing, nothing, nothing, nothing, nothing, nothing, nothing)
    for place in CLOSE_BY:
        for c in range(place * surfaces, (place + 1) * surfaces):
            candidate = voter_at(voters, c)
            there = candidate.weight > 0
            if lanes_of(there) == 0:
                continue
            said = support(c, voters, surfaces, frame.period)
            expected, response = said.intensity * seen.exposure, response_at(rest, 0, said.depth, frame)
            ratio = llr(response, seen.photons, expected, likeness, frame)
            value = ratio + (said.votes - seen.against)
            if any_dark:
                value -= seen.dark * (ONE - exp(-expected))
            better = there & (value > best.value)
            found |= better
            best = where(better, Best(value, candidate.depth, candidate.tolerance, said.depth, said.intensity, said.own,
                                      response, ratio), best)
    return found, best


@line
def _write(k, place, found, best, voters, state, own, chosen, period):
    """Write what the pixels choose as surface k; returns its depth, and where it is another than before."""
    (first, rows, cols), zero = place, full(ZERO)
    slope_col, slope_row, std = mean_of(best, voters, period)
    depth = best.new_depth - period * floor(best.new_depth / period)
    point = Point(depth, slope_col, slope_row, best.intensity, std, zero, zero)
    for one in range(state.shape[1]):
        point = where(best.own == F32(one), point_at(state, rows, one, cols), point)
    for f in range(FIELDS):
        store(chosen.points, k, f, first, where(found, point[f], ZERO))
    store(chosen.ratios, k, first, where(found, best.ratio, load(own, rows, k, cols)))
    had = point_at(state, rows, k, cols).intensity > 0
    return point.depth, (found & (best.own != F32(k))) | (~found & had)


@line
def _take(found, best, depth, seen, voters, rest, frame):
    """Subtract what the chosen surfaces explain, and drop the voters that agree with them; returns the photons left."""
    m, signal = len(frame.energy), where(found, max(best.response, ZERO) / frame.total_energy, ZERO)
    for l in range(m):
        re, im = without(load(rest, l, 0), load(rest, m + l, 0), l, signal, depth, frame)
        store(rest, l, 0, re)
        store(rest, m + l, 0, im)
    for q in range(len(voters)):
        voter = voter_at(voters, q)
        taken = found & agrees(voter, best, frame.period)
        store(voters, q, WEIGHT, 0, where(taken, ZERO, voter.weight))
        store(voters, q, SAYS, 0, where(taken, ZERO, voter.says))
    return where(found, left(seen.photons, signal), seen.photons)


@line
def _judge_part(first, listed, frame, state, own, max_chi2, chosen, voters, rest):
    """Let LANES of the listed pixels choose their surfaces, one after the other."""
    rows, cols, surfaces = load(listed, 0, first), load(listed, 1, first), state.shape[1]
    for c in range(len(rest)):
        store(rest, c, 0, load(frame.matched, rows, c, cols))
    empty, dark = gather_voters(rows, cols, frame, state, own, max_chi2, voters)
    photons, exposure, nothing = load(frame.counts, rows, cols), load(frame.exposure, rows, cols), full(ZERO)
    has_surface = load(voters, MIDDLE * surfaces, COUNT, 0) > 0
    needed, dark = where(has_surface, BIRTH_COST, BIRTH_COST + empty), where(has_surface, ZERO, dark)
    seen = Seen(photons, exposure, where(has_surface, ALWAYS, needed), dark, nothing)
    for k in range(surfaces):
        if k > 0:
            seen = Seen(seen.photons, exposure, needed, dark, speak_against(k, voters, surfaces))
        found, best = _choose(k, seen, voters, rest, surfaces, frame)
        depth, changed = _write(k, (first, rows, cols), found, best, voters, state, own, chosen, frame.period)
        bits = lanes_of(changed)
        for x in range(LANES):
            if bits >> x & 1:
                row, col = listed[0, first + x], listed[1, first + x]
                chosen.near[row - VOTE_RADIUS:row + VOTE_RADIUS + 1, col - VOTE_RADIUS:col + VOTE_RADIUS + 1] = ONE
                chosen.stale[row, col // LANES] = True
        if k + 1 < surfaces:
            seen = Seen(_take(found, best, depth, seen, voters, rest, frame), exposure, needed, dark, nothing)


@line
def _adopt(listed, number, chosen, state, own):
    """Write what the listed pixels have chosen into the maps; whether anything has changed."""
    changed = False
    for n in range(number):
        row, col = listed[0, n], listed[1, n]
        changed |= chosen.near[row, col] > ZERO
        for k in range(state.shape[1]):
            own[row, k, col] = chosen.ratios[k, n]
            for f in range(FIELDS):
                state[row, k, f, col] = chosen.points[k, f, n]
    return changed


@parallel
def _round(frame: Frame, state: floats4d, own: floats3d, max_chi2: float32, grows: boolean, lists: Lists,
           chosen: Chosen, scratch: Scratch):
    """List the undecided pixels, let them choose, and adopt what they have chosen; whether anything has changed.

    `own` are the points' ratios.
    """
    (columns, numbers, listed), near = lists, chosen.near      # numba drops what a loop itself writes to a field
    for turn in prange(len(state) - 2 * MARGIN):
        row = turn + MARGIN
        numbers[row] = list_row(row, frame, state, max_chi2, near, grows, columns[row])
    number = join_rows(columns, numbers, listed)
    for row in prange(len(state)):
        near[row, :] = ZERO
    for part in prange(-(-number // LANES)):
        thread = numba.get_thread_id()
        _judge_part(part * LANES, listed, frame, state, own, max_chi2, chosen, scratch.voters[thread],
                    scratch.rest[thread])
    return _adopt(listed, number, chosen, state, own)


def birth_death(work, frame, state, terms, max_chi2):
    """A round of spreading looks only around the surfaces that the last one has changed."""
    frame = Frame.of(frame)
    own = log_likelihood_ratio(work, frame, state, terms)
    lists = Lists(work.columns, work.numbers, work.listed)
    chosen, scratch = Chosen(work.chosen, work.chosen_ratios, work.near, work.stale), Scratch(
        work.voters, work.undecided_sketches)
    np.max(state[:, :, INTENSITY], axis=1, out=work.had)
    work.near[:], work.stale[:] = 1, False
    for spreads in range(1 + SPREAD):
        if not _round(frame, state, own, F32(max_chi2), spreads > 0, lists, chosen, scratch):
            break
    expand_stale(frame, state, work.stale, terms)
    refuse_growth(work, frame, state, terms)
    if state.shape[1] > 1:
        drop_ghosts(work, frame, state)
        expand_stale(frame, state, work.stale, terms)
    return state, terms
