"""The surfaces around a pixel, which vote in the birth/death update; TOGETHER pixels at a time, counted by x."""

import numpy as np

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.constants import NEAR_SIGMA, VOTE_RADIUS
from srt3d_ros.kernels.cpu.arithmetic import F32, ONE, ZERO, U
from srt3d_ros.kernels.cpu.compiling import line
from srt3d_ros.kernels.cpu.method import field
from srt3d_ros.kernels.cpu.method.field import is_surface, rise

VOTE, BIRTH_COST = F32(constants.VOTE), F32(constants.BIRTH_COST)
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
    """A record type with TOGETHER numbers for each name, which do not overlap, as vector registers demand."""
    return np.dtype([(name, np.float32, TOGETHER) for name in names])


# A surface of the neighbourhood, carried to the pixel: t, v, r, w, what it votes at full agreement (nats), and how many
# surfaces its pixel has (in the first of them). The weight is 0 where there is none, or where it has been taken.
VOTER = of_pixels("depth", "tolerance", "intensity", "weight", "vote", "count")
# The pixels' matched sketches z at a frequency, less what the surfaces found so far explain.
REST = of_pixels("real", "imaginary")
# Of the pixels, of the candidate that is being judged, and of the best one so far.
PIXELS = of_pixels("photons", "exposure", "needed", "dark", "against",
                   "at", "tolerance", "votes", "weight", "shift", "depth", "intensity", "own", "response", "ratio",
                   "most", "best", "best_depth", "best_own", "best_response", "best_ratio")
VOTER_SIZE, REST_SIZE, PIXELS_SIZE = (record.itemsize // 4 for record in (VOTER, REST, PIXELS))


@line
def load_pixels(at, frame, pixels, rest):
    """Load what the pixels, at rows and columns `at`, have seen."""
    m = U(len(rest))
    for x in range(L):
        row, col = at[0, x], at[1, x]
        pixels.photons[x], pixels.exposure[x] = frame.counts[row, col], frame.exposure[row, col]
        for l in range(m):
            rest[l].real[x], rest[l].imaginary[x] = frame.matched[row, l, col], frame.matched[row, m + l, col]


@line
def gather_voters(at, frame, state, own, max_chi2, pixels, voters):
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
