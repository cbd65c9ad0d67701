"""The surfaces around LANES pixels, which vote in the birth/death update, each carried to its pixel along its plane."""

from typing import NamedTuple

import numpy as np

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.constants import NEAR_SIGMA, VOTE_RADIUS
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, TINY, ZERO, agreement, is_surface, wrap
from srt3d_ros.kernels.cpu.compiling import inline, line
from srt3d_ros.kernels.cpu.vectors import floats, full, gather, lanes_of, load, store, where
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, SLOPE_COL, SLOPE_ROW, STD

VOTE, BIRTH_COST, FEWER_COST = F32(constants.VOTE), F32(constants.BIRTH_COST), F32(constants.FEWER_COST)
MAX_VOTE, EMPTY_VOTE = F32(constants.MAX_VOTES * constants.VOTE), F32(constants.EMPTY_VOTES * constants.VOTE)
SIDE = 2 * VOTE_RADIUS + 1
PLACES, MIDDLE = SIDE * SIDE, VOTE_RADIUS * (SIDE + 1)      # of the neighbourhood, row by row; the pixel itself
ROW, COL = np.indices((SIDE, SIDE)).reshape(2, -1) - VOTE_RADIUS
NEARNESS = np.exp(-(ROW**2 + COL**2) / (2 * NEAR_SIGMA**2)).astype(np.float32)      # w of each place
VOTING = np.where(np.arange(PLACES) == MIDDLE, ZERO, NEARNESS)                      # w of its votes: the pixel has none

# Of a voter: its depth at the pixel, v, r, slopes, std, w (0: there is none, or it has been taken), what it votes at
# full agreement (nats), and how many surfaces its pixel has (in the first of them).
AT, TOLERANCE, BRIGHT, COL_SLOPE, ROW_SLOPE, DEVIATION, WEIGHT, SAYS, COUNT = range(9)
VOTER = 9


class Support(NamedTuple):
    """What the voters say of a candidate: Σ of votes, depth and intensity, and which own surface it is (or −1)."""

    votes: floats
    depth: floats
    intensity: floats
    own: floats


@line
def gather_voters(rows, cols, frame, state, own, max_chi2, voters):
    """Write the voters of the pixels; returns what a first surface needs, and loses if bright, for empty neighbours.

    `needed` is for neighbours with photons but no surface; `dark` for those without photons.
    """
    needed, dark, blur2 = full(ZERO), full(ZERO), frame.resolution * frame.resolution
    surfaces = state.shape[1]
    for place in range(PLACES):
        dy, dx = place // SIDE - VOTE_RADIUS, place % SIDE - VOTE_RADIUS
        row, col, count = rows + dy, cols + dx, full(ZERO)
        for k in range(surfaces):
            voter = voters[place * surfaces + k]
            intensity, std = gather(state, row, k, INTENSITY, col), gather(state, row, k, STD, col)
            there = is_surface(intensity, std, frame.max_std)
            count += where(there, 1, 0)
            store(voter, WEIGHT, 0, where(there, NEARNESS[place], 0))
            if lanes_of(there) == 0:
                continue
            std, intensity = where(there, std, 0), where(there, intensity, 0)       # no other field is valid elsewhere
            slope_col = where(there, gather(state, row, k, SLOPE_COL, col), 0)
            slope_row = where(there, gather(state, row, k, SLOPE_ROW, col), 0)
            depth = where(there, gather(state, row, k, DEPTH, col), 0) - (slope_col * F32(dx) + slope_row * F32(dy))
            says = min(max(VOTE + gather(own, row, k, col), ZERO), MAX_VOTE)
            store(voter, AT, 0, depth)
            store(voter, TOLERANCE, 0, max_chi2 * std * std + blur2)
            store(voter, BRIGHT, 0, intensity)
            store(voter, COL_SLOPE, 0, slope_col)
            store(voter, ROW_SLOPE, 0, slope_row)
            store(voter, DEVIATION, 0, std)
            store(voter, SAYS, 0, where(there, VOTING[place] * says, 0))
        store(voters, place * surfaces, COUNT, 0, count)
        if lanes_of(count == 0) != 0:
            gap = where(count == 0, EMPTY_VOTE * VOTING[place], 0)
            has_photons = gather(frame.counts, row, col) > 0
            needed += where(has_photons, gap, 0)
            dark += where(~has_photons & (gather(frame.exposure, row, col) > 0), gap, 0)
    return needed, dark


@inline
def support(c, voters, surfaces, period):
    """What the voters say of candidate c."""
    at, tolerance = load(voters, c, AT, 0), load(voters, c, TOLERANCE, 0)
    votes, weights, shift, intensity = full(ZERO), full(ZERO), full(ZERO), full(ZERO)
    for q in range(len(voters)):
        near = load(voters, q, WEIGHT, 0)
        if lanes_of(near > 0) != 0:
            e = wrap(load(voters, q, AT, 0) - at, period)
            same = agreement(e, load(voters, q, TOLERANCE, 0) + tolerance)
            weight = same * near
            votes += same * load(voters, q, SAYS, 0)
            weights += weight
            shift += weight * e
            intensity += weight * load(voters, q, BRIGHT, 0)
    weights = max(weights, TINY)
    depth, intensity, own = at + shift / weights, intensity / weights, full(-ONE)
    for k in range(surfaces):
        voter = voters[MIDDLE * surfaces + k]
        is_own = agrees(voter, at, tolerance, period) & (load(voter, WEIGHT, 0) > 0)
        own = where(is_own, F32(k), own)
        depth = where(is_own, load(voter, AT, 0), depth)
        intensity = where(is_own, load(voter, BRIGHT, 0), intensity)
    return Support(votes, depth, intensity, own)


@inline
def agrees(voter, at, tolerance, period):
    """Whether a voter and a depth may be one surface's."""
    e = wrap(load(voter, AT, 0) - at, period)
    return e * e < load(voter, TOLERANCE, 0) + tolerance


@line
def speak_against(k, voters, surfaces):
    """Σ of what neighbours with surfaces, but no more than k, cost a further one; they then vote for what they show."""
    against = full(ZERO)
    for place in range(PLACES):
        count, cost = load(voters, place * surfaces, COUNT, 0), FEWER_COST * VOTING[place]
        fewer = count <= F32(k)
        against += where(fewer & (count > 0), cost, 0)
        for q in range(place * surfaces, (place + 1) * surfaces):
            shown = where(load(voters, q, WEIGHT, 0) > 0, cost, 0)
            store(voters, q, SAYS, 0, where(fewer, shown, load(voters, q, SAYS, 0)))
    return against


@line
def mean_of(best, voters, period):
    """Means of slopes and std of the voters that agree with the best candidates, weighted by w a."""
    weights, slope_col, slope_row, std = full(TINY), full(ZERO), full(ZERO), full(ZERO)
    for q in range(len(voters)):
        e = wrap(load(voters, q, AT, 0) - best.at, period)
        weight = load(voters, q, WEIGHT, 0) * agreement(e, load(voters, q, TOLERANCE, 0) + best.tolerance)
        weights += weight
        slope_col += weight * load(voters, q, COL_SLOPE, 0)
        slope_row += weight * load(voters, q, ROW_SLOPE, 0)
        std += weight * load(voters, q, DEVIATION, 0)
    return slope_col / weights, slope_row / weights, std / weights
