"""Birth/death update: each pixel takes the neighbouring surfaces with the highest log-likelihood ratio, or none.

The surfaces q in the square of VOTE_RADIUS vote, but not the pixel's own. Each is carried to the pixel along its
plane, to t_q − slopes · offset, and may be off by v_q = max_chi2 · std² + δ². A candidate c is one of those of the 3
× 3 pixels in the middle. It agrees with q by a_qc = (1 − e² / (v_q + v_c))₊, where e = wrap(t_q − t_c). Its depth and
intensity are those of the pixel's own surface that agrees, else the means of all that agree, weighted by w_q a_qc
with w = exp(−distance² / 2 NEAR_SIGMA²).
The pixel's surface k is the candidate with the highest

    ratio of the pixel's photons + Σ_q w_q a_qc clip(VOTE + ratio_q, 0, MAX_VOTES · VOTE)
        − Σ FEWER_COST w (k > 0: neighbours with a surface, but no more than k; these vote w a FEWER_COST)
        − Σ EMPTY_VOTES · VOTE · w · (1 − exp(−g r)) (no surface yet: used neighbours with neither surface nor photons)

if that is above what it needs: BIRTH_COST, and EMPTY_VOTES · VOTE · w more for each neighbour that has photons but no
surface; nothing for the first surface of a pixel that has one. Then the photons that it explains, and the surfaces that
agree with it, are left out, and the next one is chosen. `kernels.torch` has the notation and all rules.

The pixels in which something is to be decided (`undecided`) are listed, and each vector holds LANES of them.
"""

from typing import NamedTuple

import numba
from numba import boolean, float32, int32, prange

from srt3d_ros.kernels.constants import SPREAD, VOTE_RADIUS
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO, exp, sincos
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel
from srt3d_ros.kernels.cpu.method.expand import expand_stale
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.cpu.method.ghosts import drop_ghosts
from srt3d_ros.kernels.cpu.method.growth import note_surfaces, refuse_growth
from srt3d_ros.kernels.cpu.method.likelihood import LIKENESS, SHARED_LIKENESS, left, llr, log_likelihood_ratio
from srt3d_ros.kernels.cpu.method.undecided import join_rows, list_row
from srt3d_ros.kernels.cpu.method.voters import (
    AT,
    BIRTH_COST,
    COUNT,
    MIDDLE,
    SAYS,
    SIDE,
    TOLERANCE,
    WEIGHT,
    agrees,
    gather_voters,
    mean_of,
    speak_against,
    support,
)
from srt3d_ros.kernels.cpu.vectors import floats, floor, fma, full, gather, lanes_of, load, mask, store, where
from srt3d_ros.kernels.maps import DEPTH, FIELDS, INTENSITY, LANES, MARGIN, RESIDUAL, SCORE, SLOPE_COL, SLOPE_ROW, STD

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

    points: float32[:, :, ::1]
    ratios: float32[:, ::1]
    near: float32[:, ::1]
    stale: boolean[:, ::1]


class Scratch(NamedTuple):
    """Memory of each thread: the voters of LANES pixels, and what the surfaces found leave of their sketches."""

    voters: float32[:, :, :, ::1]       # [threads, PLACES · K, VOTER, LANES]
    rest: float32[:, :, ::1]            # [threads, 2m, LANES]


class Seen(NamedTuple):
    """What the pixels have seen, and what a surface of theirs needs, nats."""

    photons: floats         # those that the surfaces found leave
    exposure: floats
    needed: floats          # what it must exceed
    dark: floats            # what it loses for used neighbours without photons, times 1 − exp(−g r)
    against: floats         # and for neighbours with fewer surfaces


class Best(NamedTuple):
    """The best candidates so far."""

    found: mask
    value: floats           # ratio and votes, nats
    at: floats              # where the candidate lies
    tolerance: floats       # its v
    depth: floats
    intensity: floats
    own: floats             # which of the pixel's own surfaces it is; −1: none
    response: floats
    ratio: floats


@inline
def _response(rest, depth, bin_frequencies):
    """R(z, depth) of what is left of the pixels' sketches."""
    response, m = full(ZERO), len(bin_frequencies)
    for l in range(m):
        sine, cosine = sincos(bin_frequencies[l] * depth)
        response = fma(load(rest, l, 0), cosine, fma(load(rest, m + l, 0), sine, response))
    return response


@line
def _choose(k, seen, voters, rest, surfaces, frame):
    """The candidates with the highest log-likelihood ratio as surface k, of those above what is needed."""
    likeness, any_dark = SHARED_LIKENESS if k > 0 else LIKENESS, lanes_of(seen.dark > 0) != 0
    nothing = full(ZERO)
    best = Best(full(False), seen.needed, nothing, nothing, nothing, nothing, nothing, nothing, nothing)
    for place in CLOSE_BY:
        for c in range(place * surfaces, (place + 1) * surfaces):
            there = load(voters, c, WEIGHT, 0) > 0
            if lanes_of(there) == 0:
                continue
            said = support(c, voters, surfaces, frame.period)
            expected, response = said.intensity * seen.exposure, _response(rest, said.depth, frame.bin_frequencies)
            ratio = llr(response, seen.photons, expected, likeness, frame)
            value = ratio + (said.votes - seen.against)
            if any_dark:
                value -= seen.dark * (ONE - exp(-expected))
            better = there & (value > best.value)
            best = Best(
                best.found | better, where(better, value, best.value), where(better, load(voters, c, AT, 0), best.at),
                where(better, load(voters, c, TOLERANCE, 0), best.tolerance), where(better, said.depth, best.depth),
                where(better, said.intensity, best.intensity), where(better, said.own, best.own),
                where(better, response, best.response), where(better, ratio, best.ratio))
    return best


@line
def _write(k, place, best, voters, state, own, chosen, period):
    """Write what the pixels choose as surface k; returns its depth, and where it is another than before."""
    first, rows, cols = place
    slope_col, slope_row, std = mean_of(best, voters, period)
    depth = best.depth - period * floor(best.depth / period)
    for f, mean in ((DEPTH, depth), (SLOPE_COL, slope_col), (SLOPE_ROW, slope_row), (INTENSITY, best.intensity),
                    (STD, std), (SCORE, full(ZERO)), (RESIDUAL, full(ZERO))):
        value = mean
        for one in range(state.shape[1]):
            value = where(best.own == F32(one), gather(state, rows, one, f, cols), value)
        if f == DEPTH:
            depth = value
        store(chosen.points, k, f, first, where(best.found, value, ZERO))
    store(chosen.ratios, k, first, where(best.found, best.ratio, gather(own, rows, k, cols)))
    had = gather(state, rows, k, INTENSITY, cols) > 0
    return depth, (best.found & (best.own != F32(k))) | (~best.found & had)


@line
def _take(best, depth, seen, voters, rest, frame):
    """Subtract what the chosen surfaces explain, and drop the voters that agree with them; returns the photons left."""
    m, signal = len(frame.energy), where(best.found, max(best.response, ZERO) / frame.total_energy, ZERO)
    for l in range(m):
        sine, cosine = sincos(frame.bin_frequencies[l] * depth)
        store(rest, l, 0, load(rest, l, 0) - signal * frame.energy[l] * cosine)
        store(rest, m + l, 0, load(rest, m + l, 0) - signal * frame.energy[l] * sine)
    for q in range(len(voters)):
        taken = best.found & agrees(voters[q], best.at, best.tolerance, frame.period)
        store(voters, q, WEIGHT, 0, where(taken, ZERO, load(voters, q, WEIGHT, 0)))
        store(voters, q, SAYS, 0, where(taken, ZERO, load(voters, q, SAYS, 0)))
    return where(best.found, left(seen.photons, signal), seen.photons)


@line
def _judge_part(first, listed, frame, state, own, max_chi2, chosen, voters, rest):
    """Let LANES of the listed pixels choose their surfaces, one after the other."""
    rows, cols, surfaces = load(listed, 0, first), load(listed, 1, first), state.shape[1]
    for c in range(len(rest)):
        store(rest, c, 0, gather(frame.matched, rows, c, cols))
    empty, dark = gather_voters(rows, cols, frame, state, own, max_chi2, voters)
    photons, exposure, nothing = gather(frame.counts, rows, cols), gather(frame.exposure, rows, cols), full(ZERO)
    has_surface = load(voters, MIDDLE * surfaces, COUNT, 0) > 0
    needed, dark = where(has_surface, BIRTH_COST, BIRTH_COST + empty), where(has_surface, ZERO, dark)
    seen = Seen(photons, exposure, where(has_surface, ALWAYS, needed), dark, nothing)
    for k in range(surfaces):
        if k > 0:
            seen = Seen(seen.photons, exposure, needed, dark, speak_against(k, voters, surfaces))
        best = _choose(k, seen, voters, rest, surfaces, frame)
        depth, changed = _write(k, (first, rows, cols), best, voters, state, own, chosen, frame.period)
        bits = lanes_of(changed)
        for x in range(LANES):
            if bits >> x & 1:
                row, col = listed[0, first + x], listed[1, first + x]
                chosen.near[row - VOTE_RADIUS:row + VOTE_RADIUS + 1, col - VOTE_RADIUS:col + VOTE_RADIUS + 1] = ONE
                chosen.stale[row, col // LANES] = True
        if k + 1 < surfaces:
            seen = Seen(_take(best, depth, seen, voters, rest, frame), exposure, needed, dark, nothing)


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
def _round(frame: Frame, state: float32[:, :, :, ::1], own: float32[:, :, ::1], max_chi2: float32, grows: boolean,
           lists: Lists, chosen: Chosen, scratch: Scratch):
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
    note_surfaces(work, state)
    work.near[:], work.stale[:] = 1, False
    for spreads in range(1 + SPREAD):
        if not _round(frame, state, own, F32(max_chi2), spreads > 0, lists, chosen, scratch):
            break
    expand_stale(frame, state, terms, work.stale)
    refuse_growth(work, frame, state, terms)
    if state.shape[1] > 1:
        drop_ghosts(work, frame, state)
        expand_stale(frame, state, terms, work.stale)
    return state, terms
