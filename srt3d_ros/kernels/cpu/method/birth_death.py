"""Birth/death update: each pixel takes the surfaces of its neighbourhood with the highest log-likelihood ratio, or none.

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
from numba import boolean, float32, int32, prange, types

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

VOTE, BIRTH_COST, FEWER_COST = F32(constants.VOTE), F32(constants.BIRTH_COST), F32(constants.FEWER_COST)
MAX_VOTE, EMPTY_VOTE = F32(constants.MAX_VOTES * constants.VOTE), F32(constants.EMPTY_VOTES * constants.VOTE)
NEVER = F32(-1e30)
SIDE = 2 * VOTE_RADIUS + 1
PLACES, MIDDLE = SIDE * SIDE, VOTE_RADIUS * (SIDE + 1)      # of the neighbourhood, row by row; the pixel itself
ROW, COL = np.indices((SIDE, SIDE)).reshape(2, -1) - VOTE_RADIUS
WEIGHTS = np.exp(-(ROW**2 + COL**2) / (2 * NEAR_SIGMA**2)).astype(np.float32)   # w of each place
VOTING = np.where(np.arange(PLACES) == MIDDLE, ZERO, WEIGHTS)                   # w of its votes: the pixel has none
CLOSE_BY = tuple(MIDDLE + row * SIDE + col for row in (-1, 0, 1) for col in (-1, 0, 1))

TOGETHER = 16
L = U(TOGETHER)


def of_pixels(*names):
    """The type of a record with an array of TOGETHER numbers for each name.

    The compiler knows that arrays of one record do not overlap, which it must to compute in vector registers.
    """
    return np.dtype([(name, np.float32, TOGETHER) for name in names])


# A surface of the neighbourhood, carried to the pixel: t, v, r, w, what it votes at full agreement (nats), and how many
# surfaces its pixel has. The weight is 0 where there is none, or where it has been taken.
VOTER = of_pixels("depth", "tolerance", "intensity", "weight", "vote", "count")
# The pixels' matched sketches z at a frequency, less what the surfaces found so far explain.
REST = of_pixels("real", "imaginary")
# Of the pixels, of the candidate that is being judged, and of the best one so far.
PIXELS = of_pixels(
    "photons", "exposure", "needed", "dark", "against",
    "votes", "weight", "shift", "depth", "intensity", "own", "response", "ratio",
    "most", "best", "best_depth", "best_own", "best_response", "best_ratio")
VOTER_SIZE, REST_SIZE, PIXELS_SIZE = VOTER.itemsize // 4, REST.itemsize // 4, PIXELS.itemsize // 4


class Chosen(NamedTuple):
    """What the listed pixels have chosen, and where something has changed."""

    points: float32[:, :, ::1]      # [pixels, K, FIELDS]
    ratios: float32[:, ::1]         # [pixels, K], nats
    near: boolean[:, ::1]           # [rows', cols'], pixels that have a changed one in their neighbourhood


CHOSEN = types.NamedTuple(tuple(Chosen.__annotations__.values()), Chosen)


@line
def _load(at, frame, pixels, rest):
    """Load what the pixels, at rows and columns `at`, have seen."""
    m = U(len(rest))
    for x in range(L):
        row, col = at[0, x], at[1, x]
        pixels.photons[x], pixels.exposure[x] = frame.counts[row, col], frame.exposure[row, col]
        for l in range(m):
            rest[l].real[x], rest[l].imaginary[x] = frame.matched[row, l, col], frame.matched[row, m + l, col]


@line
def _gather(at, frame, state, own, max_chi2, pixels, voters):
    """Load the voters, place by place, and sum up what a surface of the pixels needs."""
    surfaces, blur2 = state.shape[1], frame.resolution * frame.resolution
    for x in range(L):
        pixels.needed[x], pixels.dark[x], pixels.against[x], pixels.best[x] = BIRTH_COST, ZERO, ZERO, -ONE
    for place in range(PLACES):
        dy, dx, first = place // SIDE - VOTE_RADIUS, place % SIDE - VOTE_RADIUS, U(place * surfaces)
        counted = voters[first]
        for x in range(L):
            counted.count[x] = ZERO
        for k in range(U(surfaces)):
            voter = voters[first + k]
            for x in range(L):
                row, col = U(at[0, x] + dy), U(at[1, x] + dx)
                std, intensity = state[row, k, field.STD, col], state[row, k, field.INTENSITY, col]
                there = ONE if is_surface(intensity, std, frame.max_std) else ZERO
                counted.count[x] += there
                voter.depth[x] = state[row, k, field.DEPTH, col] - rise(
                    state[row, k, field.SLOPE_COL, col], state[row, k, field.SLOPE_ROW, col], F32(dx), F32(dy))
                voter.tolerance[x] = max_chi2 * std * std + blur2
                voter.intensity[x] = intensity
                voter.weight[x] = there * WEIGHTS[place]
                voter.vote[x] = there * VOTING[place] * min(max(VOTE + own[row, k, col], ZERO), MAX_VOTE)
        for x in range(L):
            row, col = U(at[0, x] + dy), U(at[1, x] + dx)
            gap = EMPTY_VOTE * VOTING[place] if counted.count[x] == ZERO else ZERO
            has_photons = frame.counts[row, col] > ZERO
            pixels.needed[x] += gap if has_photons else ZERO
            pixels.dark[x] += gap if (not has_photons) & (frame.exposure[row, col] > ZERO) else ZERO
    for x in range(L):
        has_surface = voters[U(MIDDLE * surfaces)].count[x] > ZERO
        pixels.most[x] = NEVER if has_surface else pixels.needed[x]
        pixels.needed[x] = BIRTH_COST if has_surface else pixels.needed[x]
        pixels.dark[x] = ZERO if has_surface else pixels.dark[x]


@inline
def _support(c, pixels, voters, surfaces, period):
    """Sum up the votes for voter c, and find its depth and intensity in the pixels, and which surface of theirs it is."""
    candidate = voters[c]
    for x in range(L):
        pixels.votes[x] = pixels.weight[x] = pixels.shift[x] = pixels.intensity[x] = ZERO
        pixels.own[x] = -ONE
    for q in range(U(len(voters))):
        voter = voters[q]
        for x in range(L):
            e = wrap(voter.depth[x] - candidate.depth[x], period)
            same = agreement(e, voter.tolerance[x] + candidate.tolerance[x])
            weight = same * voter.weight[x]
            pixels.votes[x] += same * voter.vote[x]
            pixels.weight[x] += weight
            pixels.shift[x] += weight * e
            pixels.intensity[x] += weight * voter.intensity[x]
    for x in range(L):
        weight = max(pixels.weight[x], TINY)
        pixels.depth[x] = candidate.depth[x] + pixels.shift[x] / weight
        pixels.intensity[x] /= weight
    for k in range(U(surfaces)):
        voter = voters[U(MIDDLE * surfaces) + k]
        for x in range(L):
            e = wrap(voter.depth[x] - candidate.depth[x], period)
            is_own = (e * e < voter.tolerance[x] + candidate.tolerance[x]) & (voter.weight[x] > ZERO)
            pixels.own[x] = F32(k) if is_own else pixels.own[x]
            pixels.depth[x] = voter.depth[x] if is_own else pixels.depth[x]
            pixels.intensity[x] = voter.intensity[x] if is_own else pixels.intensity[x]


@inline
def _respond(pixels, rest, bin_frequencies):
    """The responses of the pixels' photons at the candidate's depths."""
    for x in range(L):
        pixels.response[x] = ZERO
    for l in range(U(len(rest))):
        for x in range(L):
            sine, cosine = sincos(bin_frequencies[l] * pixels.depth[x])
            pixels.response[x] += rest[l].real[x] * cosine + rest[l].imaginary[x] * sine


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
        there = state[row + place // SIDE - VOTE_RADIUS, :, :, col + place % SIDE - VOTE_RADIUS]
        for k in range(surfaces):
            voter = voters[q]
            e = wrap(voter.depth[x] - candidate.depth[x], period)
            weight = voter.weight[x] * agreement(e, voter.tolerance[x] + candidate.tolerance[x])
            if weight > ZERO:
                sum_of_weights += weight
                for f in range(FIELDS):
                    point[f] += weight * there[k, f]
            q += U(1)
    for f in range(FIELDS):
        point[f] /= sum_of_weights
    depth = pixels.best_depth[x]
    point[field.DEPTH] = depth - period * np.floor(depth / period)
    point[field.SCORE] = ZERO               # its pool gives it one


@line
def _take(x, depth, pixels, voters, rest, frame):
    """Leave out the photons that the best candidate explains in pixel x, at `depth`, and the voters that agree with it."""
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
def _judge(undecided: int32[::1], frame: FRAME, state: float32[:, :, :, ::1], own: float32[:, :, ::1],
           max_chi2: float32, chosen: CHOSEN):
    """Write what each of the undecided pixels, indices of padded maps, chooses; `own` are the points' ratios."""
    points, ratios, near = chosen
    surfaces, cols, number = state.shape[1], state.shape[3], len(undecided)
    for part in prange(-(-number // TOGETHER)):
        first = part * TOGETHER
        at = np.empty((2, TOGETHER), np.int64)
        for x in range(TOGETHER):               # the last part repeats its last pixel, whose results are dropped
            pixel = undecided[min(first + x, number - 1)]
            at[0, x], at[1, x] = pixel // cols, pixel % cols
        voters, rest = aligned(PLACES * surfaces * VOTER_SIZE).view(VOTER), aligned(len(frame.energy) * REST_SIZE).view(REST)
        scratch = aligned(PIXELS_SIZE).view(PIXELS)
        _load(at, frame, scratch[0], rest)
        _gather(at, frame, state, own, max_chi2, scratch[0], voters)
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
                else:
                    for f in range(FIELDS):
                        point[f] = state[row, one, f, col]
                if k + 1 < surfaces:
                    _take(x, point[field.DEPTH], pixels, voters, rest, frame)


@serial
def _write(undecided: int32[::1], chosen: CHOSEN, state: float32[:, :, :, ::1], own: float32[:, :, ::1]):
    for n in range(len(undecided)):
        row, col = undecided[n] // state.shape[3], undecided[n] % state.shape[3]
        own[row, :, col] = chosen.ratios[n]
        state[row, :, :, col] = chosen.points[n]


def birth_death(frame, state, terms, max_chi2):
    """A step of spreading looks only where the last step has changed something: elsewhere it would decide as before."""
    own, compiled, size = log_likelihood_ratio(frame, state, terms), as_compiled(frame), frame.counts.size
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
