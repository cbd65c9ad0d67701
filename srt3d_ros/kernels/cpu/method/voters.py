"""Who decides and who votes in the birth/death update: the pixels to decide, and the surfaces around them.

A pixel is decided if each surface of its 3 × 3 neighbourhood agrees with one of its own, e² < v + v_q with e their
distance at the pixel, and no neighbour that has surfaces has fewer than it. Voters are carried to
their pixel along their planes.
"""

from typing import NamedTuple

import numpy as np

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.constants import NEAR_SIGMA, VOTE_RADIUS
from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, ONE, TINY, ZERO, agreement, wrap
from srt3d_ros.kernels.cpu.compiling import inline, line
from srt3d_ros.kernels.cpu.method.frame import AROUND, columns, is_surface, point_at
from srt3d_ros.kernels.cpu.vectors import floats, full, lanes_of, load, store, where
from srt3d_ros.kernels.maps import LANES, MARGIN

VOTE, BIRTH_COST, FEWER_COST = F32(constants.VOTE), F32(constants.BIRTH_COST), F32(constants.FEWER_COST)
MAX_VOTE, EMPTY_VOTE = F32(constants.MAX_VOTES * constants.VOTE), F32(constants.EMPTY_VOTES * constants.VOTE)
SIDE = 2 * VOTE_RADIUS + 1
PLACES, MIDDLE = SIDE * SIDE, VOTE_RADIUS * (SIDE + 1)      # of the neighbourhood, row by row; the pixel itself
ROW, COL = np.indices((SIDE, SIDE)).reshape(2, -1) - VOTE_RADIUS
NEARNESS = np.exp(-(ROW**2 + COL**2) / (2 * NEAR_SIGMA**2)).astype(np.float32)      # w of each place
VOTING = np.where(np.arange(PLACES) == MIDDLE, ZERO, NEARNESS)                      # w of its votes: the pixel has none


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


class Support(NamedTuple):
    """What the voters say of a candidate: Σ of votes, depth and intensity, and which own surface it is (or −1)."""

    votes: floats
    depth: floats
    intensity: floats
    own: floats


@inline
def voter_at(voters, q):
    """Voter q of the pixels; fields that the caller does not use are not read."""
    return Voter(load(voters, q, 0, 0), load(voters, q, 1, 0), load(voters, q, 2, 0), load(voters, q, 3, 0),
                 load(voters, q, 4, 0), load(voters, q, 5, 0), load(voters, q, 6, 0), load(voters, q, 7, 0),
                 load(voters, q, 8, 0))


@inline
def _tolerance(point, state, place, max_chi2, frame):
    """v of points k of pixels, the square of how far their depths may be off: max_chi2 · std² + min(δ, Δ / 2)²."""
    (row, k, col), room = place, full(frame.resolution * frame.resolution)
    for o in range(state.shape[1]):
        if o != k:
            other = point_at(state, row, o, col)
            there = is_surface(other, frame)
            if lanes_of(there) != 0:
                half = HALF * wrap(other.depth - point.depth, frame.period)
                room = where(there, min(room, half * half), room)
    return max_chi2 * point.std * point.std + room


@line
def gather_voters(rows, cols, frame, state, own, max_chi2, voters):
    """Write the voters of the pixels; returns what a first surface needs, and loses if bright, for empty neighbours.

    `needed` is for neighbours with photons but no surface; `dark` for those without photons.
    """
    needed, dark, surfaces, nothing = full(ZERO), full(ZERO), state.shape[1], full(ZERO)
    for place in range(PLACES):
        dy, dx = place // SIDE - VOTE_RADIUS, place % SIDE - VOTE_RADIUS
        row, col, count = rows + dy, cols + dx, full(ZERO)
        for k in range(surfaces):
            q, point = place * surfaces + k, point_at(state, row, k, col)
            there = is_surface(point, frame)
            count += where(there, 1, 0)
            weight = where(there, NEARNESS[place], 0)
            store(voters, q, WEIGHT, 0, weight)
            if lanes_of(there):
                depth = point.depth - (point.slope_col * F32(dx) + point.slope_row * F32(dy))
                tolerance = _tolerance(point, state, (row, k, col), max_chi2, frame)
                says = VOTING[place] * min(max(VOTE + load(own, row, k, col), ZERO), MAX_VOTE)
                voter = Voter(depth, tolerance, point.intensity, point.slope_col, point.slope_row, point.std, weight,
                              says, nothing)
                voter = where(there, voter, 0)          # elsewhere no field is valid but the weight
                for field in range(len(voter)):
                    store(voters, q, field, 0, voter[field])
        store(voters, place * surfaces, COUNT, 0, count)
        if lanes_of(count == 0):
            gap = where(count == 0, EMPTY_VOTE * VOTING[place], 0)
            has_photons = load(frame.counts, row, col) > 0
            needed += where(has_photons, gap, 0)
            dark += where(~has_photons & (load(frame.exposure, row, col) > 0), gap, 0)
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
    """What the voters say of candidate c."""
    candidate = voter_at(voters, c)
    votes, weights, shift, intensity = full(ZERO), full(ZERO), full(ZERO), full(ZERO)
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
    depth, intensity, own = candidate.depth + shift / weights, intensity / weights, full(-ONE)
    for k in range(surfaces):
        voter = voter_at(voters, MIDDLE * surfaces + k)
        is_own = agrees(voter, candidate, period) & (voter.weight > 0)
        own, depth = where(is_own, F32(k), own), where(is_own, voter.depth, depth)
        intensity = where(is_own, voter.intensity, intensity)
    return Support(votes, depth, intensity, own)


@line
def speak_against(k, voters, surfaces):
    """Σ of what neighbours with surfaces, but no more than k, cost a further one; they then vote for what they show."""
    against = full(ZERO)
    for place in range(PLACES):
        count, cost = load(voters, place * surfaces, COUNT, 0), FEWER_COST * VOTING[place]
        fewer = count <= F32(k)
        against += where(fewer & (count > 0), cost, 0)
        for q in range(place * surfaces, (place + 1) * surfaces):
            voter = voter_at(voters, q)
            store(voters, q, SAYS, 0, where(fewer, where(voter.weight > 0, cost, 0), voter.says))
    return against


@line
def mean_of(candidate, voters, period):
    """Means of slopes and std of the voters that agree with the candidates, weighted by w a."""
    weights, slope_col, slope_row, std = full(TINY), full(ZERO), full(ZERO), full(ZERO)
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
def _is_unknown(state, row, q, col, offset, max_chi2, frame):
    """Whether the neighbours' surfaces q agree with none of the pixels' own; and whether there are any."""
    (dy, dx), other = offset, point_at(state, row + offset[0], q, col + offset[1])
    there = unknown = is_surface(other, frame)
    depth = other.depth - (other.slope_col * F32(dx) + other.slope_row * F32(dy))
    tolerance = _tolerance(other, state, (row + dy, q, col + dx), max_chi2, frame)
    for k in range(state.shape[1]):
        own = point_at(state, row, k, col)
        e, v = wrap(depth - own.depth, frame.period), _tolerance(own, state, (row, k, col), max_chi2, frame)
        unknown &= ~(is_surface(own, frame) & (e * e < tolerance + v))
    return unknown, there


@line
def _undecided(state, row, col, max_chi2, frame, grows):
    """In which of the pixels from (row, col) on there is something to decide, as bits."""
    surfaces, had = state.shape[1], full(ZERO)
    for k in range(surfaces):
        had += where(is_surface(point_at(state, row, k, col), frame), 1, 0)
    undecided, may_grow = full(False), had < F32(surfaces)
    if grows and lanes_of(may_grow) == 0:
        return 0
    for offset in AROUND:
        around = full(ZERO)
        for q in range(surfaces):
            unknown, there = _is_unknown(state, row, q, col, offset, max_chi2, frame)
            around += where(there, 1, 0)
            undecided |= unknown
        undecided |= (around > 0) & (around < had)
    undecided &= load(frame.exposure, row, col) > 0
    return lanes_of(undecided & may_grow if grows else undecided)


@line
def list_row(row, frame, state, max_chi2, near, grows, cols):
    """Write the columns of a row's used pixels that have something to decide; returns how many they are.

    Only pixels near a change, where `near` is 1; if surfaces grow (`grows`), with fewer than K surfaces.
    """
    found = 0
    for first in columns(state):
        close = lanes_of(load(near, row, first) > 0)
        if close != 0:
            close &= _undecided(state, row, first, max_chi2, frame, grows)
            for x in range(LANES):
                if close >> x & 1:
                    cols[found] = first + x
                    found += 1
    return found


@line
def join_rows(cols, number, pixels):
    """Join the lists of the rows; repeat the last pixel up to whole vectors. Returns how many there are."""
    found = 0
    for i in range(MARGIN, len(cols) - MARGIN):
        for n in range(number[i]):
            pixels[0, found], pixels[1, found] = i, cols[i, n]
            found += 1
    for n in range(found, found + -found % LANES):
        pixels[0, n], pixels[1, n] = pixels[0, found - 1], pixels[1, found - 1]
    return found
