"""Who decides and who votes in the birth/death update: the pixels to decide, and the surfaces around them.

A pixel is decided if each surface of its 3 × 3 neighbourhood agrees with one of its own, e² < v + v_q with e their
distance at the pixel, and no neighbour that has surfaces has fewer than it. Voters are carried to
their pixel along their planes.
"""

from typing import NamedTuple

import numpy as np
from numba import float32

from srt3d_ros.kernels.constants import (
    EMPTY_VOTES,
    FEWER_COST,
    MAX_VOTES,
    NEAR_SIGMA,
    TINY,
    VOTE,
    VOTE_RADIUS,
)
from srt3d_ros.kernels.cpu.arithmetic import agreement, wrap
from srt3d_ros.kernels.cpu.compiling import floats3d, floats4d, inline, line
from srt3d_ros.kernels.cpu.method.frame import AROUND, Frame, is_surface, point_at
from srt3d_ros.kernels.cpu.spans import ALL, columns, first_of
from srt3d_ros.kernels.cpu.vectors import floats, full, lanes_of, where
from srt3d_ros.kernels.maps import LANES, MARGIN

MAX_VOTE, EMPTY_VOTE = MAX_VOTES * VOTE, EMPTY_VOTES * VOTE
SIDE = 2 * VOTE_RADIUS + 1
PLACES, MIDDLE = SIDE * SIDE, VOTE_RADIUS * (SIDE + 1)      # of the neighbourhood, row by row; the pixel itself
ROW, COL = np.indices((SIDE, SIDE)).reshape(2, -1) - VOTE_RADIUS
NEARNESS = np.exp(-(ROW**2 + COL**2) / (2 * NEAR_SIGMA**2)).astype(np.float32)      # w of each place
VOTING = np.where(np.arange(PLACES) == MIDDLE, 0, NEARNESS)                         # w of its votes: the pixel has none


class Voter(NamedTuple):
    """A surface around each of LANES pixels: what it is at the pixel, and what it says."""

    depth: floats
    tolerance: floats       # v, bins²
    intensity: floats
    slope_col: floats
    slope_row: floats
    std: floats
    weight: floats          # w; 0: there is none, or it has been taken
    says: floats            # what it votes at full agreement, nats
    count: floats           # how many surfaces its pixel has; valid in the first of them


WEIGHT, SAYS, COUNT = range(6, 9)       # of a voter's fields


@inline
def voter_at(voters, q):
    """Voter q of the pixels; fields that the caller does not use are not read."""
    return Voter(voters[q, 0, ALL], voters[q, 1, ALL], voters[q, 2, ALL], voters[q, 3, ALL],
                 voters[q, 4, ALL], voters[q, 5, ALL], voters[q, 6, ALL], voters[q, 7, ALL],
                 voters[q, 8, ALL])


def write_tolerances(i, j, frame: Frame, max_chi2: float32, tolerances: floats3d, state: floats4d):
    """Write v of points, the square of how far their depths may be off: max_chi2 · std² + min(δ, Δ / 2)²."""
    for k in range(state.shape[1]):
        point, room = point_at(state, i, k, j), full(frame.resolution * frame.resolution)
        for o in range(state.shape[1]):
            if o != k:
                other = point_at(state, i, o, j)
                there = is_surface(other, frame)
                if lanes_of(there) != 0:
                    half = wrap(other.depth - point.depth, frame.period) / 2
                    room = where(there, min(room, half * half), room)
        tolerances[i, k, j] = max_chi2 * point.std * point.std + room


@line
def gather_voters(rows, cols, frame, state, own, tolerances, voters):
    """Write the voters of the pixels; returns what a first surface needs, and loses if bright, for empty neighbours.

    `needed` is for neighbours with photons but no surface; `dark` for those without photons.
    """
    needed, dark, surfaces, nothing = full(0.0), full(0.0), state.shape[1], full(0.0)
    for place in range(PLACES):
        dy, dx = place // SIDE - VOTE_RADIUS, place % SIDE - VOTE_RADIUS
        row, col, count = rows + dy, cols + dx, full(0.0)
        for k in range(surfaces):
            q, point = place * surfaces + k, point_at(state, row, k, col)
            there = is_surface(point, frame)
            count += where(there, 1, 0)
            weight = voters[q, WEIGHT, ALL] = where(there, NEARNESS[place], 0)
            if lanes_of(there):
                depth = point.depth - (point.slope_col * dx + point.slope_row * dy)
                says = VOTING[place] * min(max(VOTE + own[row, k, col], 0), MAX_VOTE)
                voter = Voter(depth, tolerances[row, k, col], point.intensity, point.slope_col, point.slope_row,
                              point.std, weight, says, nothing)
                for field, value in enumerate(where(there, voter, 0)):      # elsewhere no field is valid but the weight
                    voters[q, field, ALL] = value
        voters[place * surfaces, COUNT, ALL] = count
        if lanes_of(count == 0):
            gap = where(count == 0, EMPTY_VOTE * VOTING[place], 0)
            has_photons = frame.counts[row, col] > 0
            needed += where(has_photons, gap, 0)
            dark += where(~has_photons & (frame.exposure[row, col] > 0), gap, 0)
    return needed, dark


@inline
def _apart(voter, other, period):
    """How far a voter and another one, or a candidate, are apart, and their v."""
    return wrap(voter.depth - other.depth, period), voter.tolerance + other.tolerance


@inline
def agrees(voter, other, period):
    """Whether a voter and another one, or a candidate, may be one surface's."""
    e, tolerance = _apart(voter, other, period)
    return e * e < tolerance


@inline
def support(c, voters, surfaces, period):
    """What the voters say of candidate c: Σ of votes, its depth and intensity, and which own surface it is (or −1)."""
    candidate = voter_at(voters, c)
    votes, weights, shift, intensity = full(0.0), full(0.0), full(0.0), full(0.0)
    for q in range(len(voters)):
        voter = voter_at(voters, q)
        if lanes_of(voter.weight > 0):
            e, tolerance = _apart(voter, candidate, period)
            same = agreement(e, tolerance)
            weight = same * voter.weight
            votes += same * voter.says
            weights += weight
            shift += weight * e
            intensity += weight * voter.intensity
    weights = max(weights, TINY)
    depth, intensity, own = candidate.depth + shift / weights, intensity / weights, full(-1.0)
    for k in range(surfaces):
        voter = voter_at(voters, MIDDLE * surfaces + k)
        is_own = agrees(voter, candidate, period) & (voter.weight > 0)
        own, depth = where(is_own, k, own), where(is_own, voter.depth, depth)
        intensity = where(is_own, voter.intensity, intensity)
    return votes, depth, intensity, own


@line
def speak_against(k, voters, surfaces):
    """Σ of what neighbours with surfaces, but no more than k, cost a further one; they then vote for what they show."""
    against = full(0.0)
    for place in range(PLACES):
        count, cost = voters[place * surfaces, COUNT, ALL], FEWER_COST * VOTING[place]
        fewer = count <= k
        against += where(fewer & (count > 0), cost, 0)
        for q in range(place * surfaces, (place + 1) * surfaces):
            voter = voter_at(voters, q)
            voters[q, SAYS, ALL] = where(fewer, where(voter.weight > 0, cost, 0), voter.says)
    return against


@line
def mean_of(candidate, voters, period):
    """Means of slopes and std of the voters that agree with the candidates, weighted by w a."""
    weights, slope_col, slope_row, std = full(TINY), full(0.0), full(0.0), full(0.0)
    for q in range(len(voters)):
        voter = voter_at(voters, q)
        e, tolerance = _apart(voter, candidate, period)
        weight = voter.weight * agreement(e, tolerance)
        weights += weight
        slope_col += weight * voter.slope_col
        slope_row += weight * voter.slope_row
        std += weight * voter.std
    return slope_col / weights, slope_row / weights, std / weights


@inline
def _is_unknown(state, row, q, col, offset, tolerances, frame):
    """Whether the neighbours' surfaces q agree with none of the pixels' own; and whether there are any."""
    (dy, dx), other = offset, point_at(state, row + offset[0], q, col + offset[1])
    there = unknown = is_surface(other, frame)
    depth = other.depth - (other.slope_col * dx + other.slope_row * dy)
    tolerance = tolerances[row + dy, q, col + dx]
    for k in range(state.shape[1]):
        own = point_at(state, row, k, col)
        e = wrap(depth - own.depth, frame.period)
        unknown &= ~(is_surface(own, frame) & (e * e < tolerance + tolerances[row, k, col]))
    return unknown, there


@line
def undecided(i, j, state, tolerances, frame, grows):
    """In which used pixels there is something to decide; if surfaces grow (`grows`), with fewer than K surfaces."""
    surfaces, had, something = state.shape[1], full(0.0), full(False)
    for k in range(surfaces):
        had += where(is_surface(point_at(state, i, k, j), frame), 1, 0)
    used = frame.exposure[i, j] > 0
    if grows:
        used &= had < surfaces
    if lanes_of(used):
        for offset in AROUND:
            around = full(0.0)
            for q in range(surfaces):
                unknown, there = _is_unknown(state, i, q, j, offset, tolerances, frame)
                around += where(there, 1, 0)
                something |= unknown
            something |= (around > 0) & (around < had)
    return something & used


@line
def list_pixels(chosen, listed):
    """List rows and columns of the pixels with 1; the last one fills a vector. Returns how many vectors there are."""
    found = 0
    for i in range(MARGIN, len(chosen) - MARGIN):
        for j in columns(chosen):
            lanes = lanes_of(chosen[i, j] > 0)
            for x in range(LANES if lanes else 0):
                if lanes >> x & 1:
                    listed[0, found], listed[1, found] = i, first_of(j) + x
                    found += 1
    vectors = -(-found // LANES)
    for n in range(found, vectors * LANES):
        listed[0, n], listed[1, n] = listed[0, found - 1], listed[1, found - 1]
    return vectors
