"""Birth/death update: each pixel takes the neighbouring surfaces with the highest log-likelihood ratio, or none.

The surfaces q within VOTE_RADIUS vote. Each is carried to the pixel along its plane, to t_q − slopes · offset, and may
be off by v_q = max_chi2 · std² + δ². A candidate c is one of those of the 3 × 3 pixels in the middle. It agrees with q
by a_qc = (1 − e² / (v_q + v_c))₊, where e = wrap(t_q − t_c). Its depth and intensity are those of the pixel's own
surface that agrees, else the means of all that agree, weighted by w_q a_qc with w = exp(−distance² / 2 NEAR_SIGMA²).
The pixel's surface k is the candidate with the highest

    ratio of the pixel's photons + Σ_q w_q a_qc clip(VOTE + ratio_q, 0, MAX_VOTES · VOTE)
        − Σ FEWER_COST w (k > 0: neighbours with a surface, but no more than k)
        − Σ EMPTY_VOTES · VOTE · w · (1 − exp(−g r)) (no surface yet: neighbours without surface or photons)

if that is above what it needs: BIRTH_COST, and EMPTY_VOTES · VOTE · w more for each neighbour that has photons but no
surface; nothing for the first surface of a pixel that has one. Then the photons that it explains, and the surfaces that
agree with it, are left out, and the next one is chosen. `kernels.torch` has the notation and all rules.

The pixels in which something is to be decided (`undecided`) are taken TOGETHER at a time, in vector registers: x counts
them.
"""

from typing import NamedTuple

import numpy as np
from numba import boolean, float32, int32, prange

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.constants import SPREAD, VOTE_RADIUS
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, TINY, ZERO, U, aligned, sincos
from srt3d_ros.kernels.cpu.compiling import inline, line, parallel, serial
from srt3d_ros.kernels.cpu.device import borrow
from srt3d_ros.kernels.cpu.method import field
from srt3d_ros.kernels.cpu.method.field import agreement, wrap
from srt3d_ros.kernels.cpu.method.frame import Frame
from srt3d_ros.kernels.cpu.method.likelihood import log_likelihood_ratio
from srt3d_ros.kernels.cpu.method.likelihood_scalar import LIKENESS, SHARED_LIKENESS, left, llr, score_of
from srt3d_ros.kernels.cpu.method.undecided import list_undecided
from srt3d_ros.kernels.cpu.method.voters import (
    CLOSE_BY,
    MIDDLE,
    PIXELS,
    PIXELS_SIZE,
    PLACES,
    REST,
    REST_SIZE,
    SIDE,
    TOGETHER,
    VOTER,
    VOTER_SIZE,
    VOTING,
    L,
    gather_voters,
    load_pixels,
)
from srt3d_ros.kernels.maps import FIELDS, INTENSITY

FEWER_COST = F32(constants.FEWER_COST)


class Chosen(NamedTuple):
    """What the listed pixels have chosen: points [N, K, FIELDS], ratios [N, K], and what is near a change, a map."""

    points: float32[:, :, ::1]
    ratios: float32[:, ::1]
    near: boolean[:, ::1]


@inline
def _support(c, pixels, voters, surfaces, period):
    """Sum up the votes for voter c; find its depth and intensity in the pixels, and which of their surfaces it is."""
    candidate = voters[c]
    for x in range(L):
        pixels.at[x], pixels.tolerance[x] = candidate.depth[x], candidate.tolerance[x]
        pixels.votes[x] = pixels.weight[x] = pixels.shift[x] = pixels.intensity[x] = ZERO
        pixels.own[x] = -ONE
    for q in range(U(len(voters))):
        voter = voters[q]
        for x in range(L):
            e = wrap(voter.depth[x] - pixels.at[x], period)
            same = agreement(e, voter.tolerance[x] + pixels.tolerance[x])
            weight = same * voter.weight[x]
            pixels.votes[x] += same * voter.vote[x]
            pixels.weight[x] += weight
            pixels.shift[x] += weight * e
            pixels.intensity[x] += weight * voter.intensity[x]
    for x in range(L):
        weight = max(pixels.weight[x], TINY)
        pixels.depth[x] = pixels.at[x] + pixels.shift[x] / weight
        pixels.intensity[x] /= weight
    for k in range(U(surfaces)):
        voter = voters[U(MIDDLE * surfaces) + k]
        for x in range(L):
            e = wrap(voter.depth[x] - pixels.at[x], period)
            is_own = (e * e < voter.tolerance[x] + pixels.tolerance[x]) & (voter.weight[x] > ZERO)
            pixels.own[x] = F32(k) if is_own else pixels.own[x]
            pixels.depth[x] = voter.depth[x] if is_own else pixels.depth[x]
            pixels.intensity[x] = voter.intensity[x] if is_own else pixels.intensity[x]


@inline
def _respond(pixels, rest, bin_frequencies):
    """The responses of the pixels' photons at the candidate's depths."""
    for x in range(L):
        pixels.response[x] = ZERO
    for l in range(U(len(rest))):
        wave, frequency = rest[l], bin_frequencies[l]
        for x in range(L):
            sine, cosine = sincos(frequency * pixels.depth[x])
            pixels.response[x] += wave.real[x] * cosine + wave.imaginary[x] * sine


@line
def _choose(k, pixels, voters, rest, surfaces, frame):
    """Find the candidate with the highest log-likelihood ratio as surface k; `best` is −1 if none reaches `most`."""
    likeness, any_dark = SHARED_LIKENESS if k > 0 else LIKENESS, pixels.dark.max() > ZERO
    for place in CLOSE_BY:
        for q in range(surfaces):
            c = U(place * surfaces + q)
            candidate = voters[c]
            if candidate.weight.max() == ZERO:
                continue
            _support(c, pixels, voters, surfaces, frame.period)
            _respond(pixels, rest, frame.bin_frequencies)
            for x in range(L):
                pixels.ratio[x] = score_of(pixels.response[x], pixels.photons[x], frame)
            for x in range(L):
                expected = pixels.intensity[x] * pixels.exposure[x]
                pixels.ratio[x] = llr(pixels.ratio[x], pixels.response[x], pixels.photons[x], expected, likeness, frame)
            for x in range(L if any_dark else U(0)):
                shows = ONE - np.exp(-pixels.intensity[x] * pixels.exposure[x])
                pixels.votes[x] -= pixels.dark[x] * shows
            for x in range(L):
                value = pixels.ratio[x] + (pixels.votes[x] - pixels.against[x])
                better = (candidate.weight[x] > ZERO) & (value > pixels.most[x])
                pixels.most[x] = value if better else pixels.most[x]
                pixels.best[x] = F32(c) if better else pixels.best[x]
                pixels.best_depth[x] = pixels.depth[x] if better else pixels.best_depth[x]
                pixels.best_own[x] = pixels.own[x] if better else pixels.best_own[x]
                pixels.best_response[x] = pixels.response[x] if better else pixels.best_response[x]
                pixels.best_ratio[x] = pixels.ratio[x] if better else pixels.best_ratio[x]


@line
def _begin_further(k, pixels, voters, surfaces):
    """Let the neighbours with no more than k surfaces vote against one more, except against those that they show."""
    for x in range(L):
        pixels.most[x], pixels.best[x], pixels.against[x] = pixels.needed[x], -ONE, ZERO
    for place in range(PLACES):
        first = U(place * surfaces)
        for x in range(L):
            count = voters[first].count[x]
            pixels.against[x] += FEWER_COST * VOTING[place] if (count > ZERO) & (count <= F32(k)) else ZERO
            for q in range(first, first + U(surfaces)):
                shown = FEWER_COST * VOTING[place] if voters[q].weight[x] > ZERO else ZERO
                voters[q].vote[x] = shown if count <= F32(k) else voters[q].vote[x]


@line
def _average(x, row, col, pixels, voters, state, point, period):
    """Write the mean of the voters of pixel x, at (row, col), that agree with the best candidate into `point`."""
    surfaces, candidate, sum_of_weights, q = state.shape[1], voters[U(pixels.best[x])], ZERO, U(0)
    point[:] = ZERO
    for place in range(PLACES):
        its_row, its_col = row + place // SIDE - VOTE_RADIUS, col + place % SIDE - VOTE_RADIUS
        for k in range(surfaces):
            voter = voters[q]
            e = wrap(voter.depth[x] - candidate.depth[x], period)
            weight = voter.weight[x] * agreement(e, voter.tolerance[x] + candidate.tolerance[x])
            if weight > ZERO:
                sum_of_weights += weight
                for f in range(FIELDS):
                    point[f] += weight * state[its_row, k, f, its_col]
            q += U(1)
    for f in range(FIELDS):
        point[f] /= sum_of_weights
    depth = pixels.best_depth[x]
    point[field.DEPTH] = depth - period * np.floor(depth / period)
    point[field.SCORE] = ZERO               # its pool gives it one


@line
def _take(x, depth, pixels, voters, rest, frame):
    """Leave out what the best candidate, at `depth`, explains of the photons of pixel x, and the voters that agree."""
    candidate, signal = voters[U(pixels.best[x])], max(pixels.best_response[x], ZERO) / frame.total_energy
    at, tolerance = candidate.depth[x], candidate.tolerance[x]
    pixels.photons[x] = left(pixels.photons[x], signal)
    for l in range(U(len(rest))):
        sine, cosine = sincos(frame.bin_frequencies[l] * depth)
        rest[l].real[x] -= signal * frame.energy[l] * cosine
        rest[l].imaginary[x] -= signal * frame.energy[l] * sine
    for q in range(U(len(voters))):
        voter = voters[q]
        e = wrap(voter.depth[x] - at, frame.period)
        if e * e < voter.tolerance[x] + tolerance:
            voter.weight[x], voter.vote[x] = ZERO, ZERO


@parallel
def _judge(undecided: int32[::1], frame: Frame, state: float32[:, :, :, ::1], own: float32[:, :, ::1],
           max_chi2: float32, chosen: Chosen):
    """Write what each of the undecided pixels, indices of padded maps, chooses; `own` are the points' ratios."""
    points, ratios, near = chosen       # numba drops what a parallel loop writes to a slice of `chosen.near`
    surfaces, cols, number = state.shape[1], state.shape[3], len(undecided)
    for part in prange(-(-number // TOGETHER)):
        first = part * TOGETHER
        at = np.empty((2, TOGETHER), np.int64)
        for x in range(TOGETHER):               # the last part repeats its last pixel, whose results are dropped
            pixel = undecided[min(first + x, number - 1)]
            at[0, x], at[1, x] = pixel // cols, pixel % cols
        scratch, voters = aligned(PIXELS_SIZE).view(PIXELS), aligned(PLACES * surfaces * VOTER_SIZE).view(VOTER)
        rest = aligned(len(frame.energy) * REST_SIZE).view(REST)
        load_pixels(at, frame, scratch[0], rest)
        gather_voters(at, frame, state, own, max_chi2, scratch[0], voters)
        for k in range(surfaces):
            pixels = scratch[0]                 # here, for a record does not keep the memory of its array
            if k > 0:
                _begin_further(k, pixels, voters, surfaces)
            _choose(k, pixels, voters, rest, surfaces, frame)
            for x in range(U(min(TOGETHER, number - first))):
                row, col, point = at[0, x], at[1, x], points[first + int(x), k]
                found, one = pixels.best[x] >= ZERO, int(pixels.best_own[x])
                if one != k if found else state[row, k, INTENSITY, col] > ZERO:
                    near[row - VOTE_RADIUS:row + VOTE_RADIUS + 1, col - VOTE_RADIUS:col + VOTE_RADIUS + 1] = True
                if not found:
                    point[INTENSITY], ratios[first + int(x), k] = ZERO, own[row, k, col]
                    continue
                ratios[first + int(x), k] = pixels.best_ratio[x]
                if one < 0:
                    _average(x, row, col, pixels, voters, state, point, frame.period)
                for f in range(FIELDS if one >= 0 else 0):
                    point[f] = state[row, one, f, col]
                if k + 1 < surfaces:
                    _take(x, point[field.DEPTH], pixels, voters, rest, frame)


@serial
def _write(undecided: int32[::1], chosen: Chosen, state: float32[:, :, :, ::1], own: float32[:, :, ::1]):
    for n in range(len(undecided)):
        row, col = undecided[n] // state.shape[3], undecided[n] % state.shape[3]
        for k in range(state.shape[1]):
            own[row, k, col] = chosen.ratios[n, k]
            for f in range(FIELDS):
                state[row, k, f, col] = chosen.points[n, k, f]


def birth_death(frame, state, terms, max_chi2):
    """A step of spreading looks only where the last step has changed something: elsewhere it would decide as before."""
    own, compiled, size = log_likelihood_ratio(frame, state, terms), Frame.of(frame), frame.counts.size
    chosen = Chosen(borrow("chosen", (size, *state.shape[1:3])), borrow("chosen ratios", (size, state.shape[1])),
                    np.ones(frame.counts.shape, bool))
    for spreads in range(1 + SPREAD):
        undecided = list_undecided(compiled, state, F32(max_chi2), chosen.near, spreads > 0)
        chosen.near[:] = False
        _judge(undecided, compiled, state, own, F32(max_chi2), chosen)
        _write(undecided, chosen, state, own)
        if not chosen.near.any():
            break
    return state
