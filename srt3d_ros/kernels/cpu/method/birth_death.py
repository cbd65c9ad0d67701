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

The pixels in which something is to be decided are listed, and each vector holds LANES of them.
"""

from typing import NamedTuple

import numpy as np
from numba import boolean, get_thread_id, int32, prange

from srt3d_ros.kernels.constants import BIRTH_COST, LIKENESS, SPREAD, VOTE_RADIUS
from srt3d_ros.kernels.cpu.arithmetic import F32, exp
from srt3d_ros.kernels.cpu.compiling import each, floats2d, floats3d, floats4d, line, parallel
from srt3d_ros.kernels.cpu.method.drops import drop_ghosts, refuse_growth
from srt3d_ros.kernels.cpu.method.frame import Frame, Point, point_at, response_at, without
from srt3d_ros.kernels.cpu.method.likelihood import SHARED_LIKENESS, left, llr, log_likelihood_ratio
from srt3d_ros.kernels.cpu.method.sketches import expand_stale
from srt3d_ros.kernels.cpu.method.voters import (
    COUNT,
    MIDDLE,
    PLACES,
    SAYS,
    SIDE,
    WEIGHT,
    Voter,
    agrees,
    gather_voters,
    list_pixels,
    mean_of,
    speak_against,
    support,
    undecided,
    voter_at,
    write_tolerances,
)
from srt3d_ros.kernels.cpu.spans import ALL, span
from srt3d_ros.kernels.cpu.vectors import floats, floor, full, lanes_of, where
from srt3d_ros.kernels.maps import FIELDS, INTENSITY, LANES

ALWAYS = -1e30              # what a pixel's first surface needs if it has one: less than any has
CLOSE_BY = tuple(MIDDLE + row * SIDE + col for row in (-1, 0, 1) for col in (-1, 0, 1))     # places of candidates


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


def _find(i, j, frame: Frame, grows: boolean, state: floats4d, tolerances: floats3d, near: floats2d,
          to_decide: floats2d):
    """Write 1 where a pixel near a change has something to decide, and forget the change."""
    decides = near[i, j] > 0
    if lanes_of(decides):
        decides &= undecided(i, j, state, tolerances, frame, grows)
    to_decide[i, j], near[i, j] = where(decides, 1, 0), 0


_find_undecided = each(write_tolerances, _find)


@line
def _choose(k, seen, voters, rest, surfaces, frame):
    """The candidates with the highest log-likelihood ratio as surface k, and whether it is above what is needed."""
    likeness, any_dark, found = SHARED_LIKENESS if k > 0 else LIKENESS, lanes_of(seen.dark > 0) != 0, full(False)
    nothing = full(0.0)
    best = Best(seen.needed, nothing, nothing, nothing, nothing, nothing, nothing, nothing)
    for place in CLOSE_BY:
        for c in range(place * surfaces, (place + 1) * surfaces):
            candidate = voter_at(voters, c)
            there = candidate.weight > 0
            if lanes_of(there) == 0:
                continue
            votes, depth, intensity, own = support(c, voters, surfaces, frame.period)
            expected, response = intensity * seen.exposure, response_at(rest, ALL, depth, frame)
            ratio = llr(response, seen.photons, expected, likeness, frame)
            value = ratio + (votes - seen.against)
            if any_dark:
                value -= seen.dark * (1 - exp(-expected))
            better = there & (value > best.value)
            found |= better
            best = where(better, Best(value, candidate.depth, candidate.tolerance, depth, intensity, own, response,
                                      ratio), best)
    return found, best


@line
def _point_of(best, rows, cols, voters, state, period):
    """The points that the candidates make: the pixels' own ones, or new ones."""
    slope_col, slope_row, std = mean_of(best, voters, period)
    depth, nothing = best.new_depth - period * floor(best.new_depth / period), full(0.0)
    point = Point(depth, slope_col, slope_row, best.intensity, std, nothing, nothing)
    for k in range(state.shape[1]):
        point = where(best.own == k, point_at(state, rows, k, cols), point)
    return point


@line
def _take(found, best, depth, seen, voters, rest, frame):
    """Subtract what the chosen surfaces explain, and drop the voters that agree with them; returns the photons left."""
    m, signal = len(frame.energy), where(found, max(best.response, 0) / frame.total_energy, 0)
    for l in range(m):
        rest[l, ALL], rest[m + l, ALL] = without(rest[l, ALL], rest[m + l, ALL], l, signal, depth, frame)
    for q in range(len(voters)):
        voter = voter_at(voters, q)
        taken = found & agrees(voter, best, frame.period)
        voters[q, WEIGHT, ALL] = where(taken, 0, voter.weight)
        voters[q, SAYS, ALL] = where(taken, 0, voter.says)
    return where(found, left(seen.photons, signal), seen.photons)


@line
def _judge(at, listed, frame, state, own, tolerances, points, ratios, near, stale, voters, rest):
    """Let LANES of the listed pixels choose their surfaces, one after the other, and write 1 near changes."""
    rows, cols, surfaces = listed[0, span(at)], listed[1, span(at)], state.shape[1]
    for c in range(len(rest)):
        rest[c, ALL] = frame.matched[rows, c, cols]
    empty, dark = gather_voters(rows, cols, frame, state, own, tolerances, voters)
    photons, exposure, nothing = frame.counts[rows, cols], frame.exposure[rows, cols], full(0.0)
    has_surface = voters[MIDDLE * surfaces, COUNT, ALL] > 0
    needed, dark = where(has_surface, BIRTH_COST, BIRTH_COST + empty), where(has_surface, 0, dark)
    seen = Seen(photons, exposure, where(has_surface, ALWAYS, needed), dark, nothing)
    for k in range(surfaces):
        if k > 0:
            seen = Seen(seen.photons, exposure, needed, dark, speak_against(k, voters, surfaces))
        found, best = _choose(k, seen, voters, rest, surfaces, frame)
        point = _point_of(best, rows, cols, voters, state, frame.period)
        for field, value in enumerate(point):
            points[k, field, span(at)] = where(found, value, 0)
        ratios[k, span(at)] = where(found, best.ratio, own[rows, k, cols])
        had = state[rows, k, INTENSITY, cols] > 0
        changed = lanes_of((found & (best.own != k)) | (~found & had))
        for x in range(LANES if changed else 0):
            if changed >> x & 1:
                row, col = listed[0, at + x], listed[1, at + x]
                near[row - VOTE_RADIUS:row + VOTE_RADIUS + 1, col - VOTE_RADIUS:col + VOTE_RADIUS + 1] = 1
                stale[row, col] = 1
        if k + 1 < surfaces:
            seen = Seen(_take(found, best, point.depth, seen, voters, rest, frame), exposure, needed, dark, nothing)


@line
def _adopt(at, listed, points, ratios, near, state, own):
    """Write what LANES of the listed pixels have chosen into the maps; returns which have changed, as bits."""
    rows, cols = listed[0, span(at)], listed[1, span(at)]
    for k in range(state.shape[1]):
        own[rows, k, cols] = ratios[k, span(at)]
        for field in range(FIELDS):
            state[rows, k, field, cols] = points[k, field, span(at)]
    return lanes_of(near[rows, cols] > 0)


@parallel
def _decide(frame: Frame, state: floats4d, own: floats3d, tolerances: floats3d, to_decide: floats2d,
            listed: int32[:, ::1], points: floats3d, ratios: floats2d, near: floats2d, stale: floats2d,
            voters: floats4d, rest: floats3d):
    """Let the pixels to decide choose their surfaces, then adopt these; whether any has changed.

    `own` are the points' ratios.
    """
    vectors, changed = list_pixels(to_decide, listed), 0
    for n in prange(vectors):
        t = get_thread_id()
        _judge(n * LANES, listed, frame, state, own, tolerances, points, ratios, near, stale, voters[t], rest[t])
    for n in prange(vectors):
        changed += _adopt(n * LANES, listed, points, ratios, near, state, own)
    return changed > 0


def birth_death(work, frame, state, terms, max_chi2):
    """A round of spreading looks only around the surfaces that the last one has changed."""
    frame, pixels, tolerances = Frame.of(frame), work.height * work.width, work.map("tolerances", work.surfaces)
    near, stale, had, to_decide = map(work.map, ("near", "stale", "had", "to decide"))
    own = log_likelihood_ratio(work, frame, state, terms)
    memory = (work.array("listed pixels", 2, pixels, of=np.int32),
              work.array("chosen", work.surfaces, FIELDS, pixels), work.array("chosen ratios", work.surfaces, pixels),
              near, stale,
              work.array("voters", work.threads, PLACES * work.surfaces, len(Voter._fields), LANES),
              work.array("rest", work.threads, frame.matched.shape[1], LANES))
    np.max(state[:, :, INTENSITY], axis=1, out=had)
    near[:], stale[:] = 1, 0
    for spreads in range(1 + SPREAD):
        _find_undecided(frame, F32(max_chi2), tolerances, state, spreads > 0, near, to_decide)
        if not _decide(frame, state, own, tolerances, to_decide, *memory):
            break
    expand_stale(frame, state, terms, stale)
    refuse_growth(work, frame, state, terms, had)
    if work.surfaces > 1:
        drop_ghosts(work, frame, state)
        expand_stale(frame, state, terms, stale)
    return state, terms
