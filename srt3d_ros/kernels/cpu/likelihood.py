"""How much more likely a pixel's own photons are with a surface than without; `oracle.likelihood` has the equations."""

import numpy as np

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cpu.arithmetic import EPSILON, F32, HALF, ONE, ZERO, log
from srt3d_ros.kernels.cpu.compiling import inline

LIKENESS, DEAD = F32(constants.LIKENESS), F32(constants.DEAD_VOTES * constants.VOTE)
SHARED_LIKENESS = LIKENESS * LIKENESS


def noise_ratio(frame, depth):
    return 1.0 if frame.clutter is None else frame.clutter[np.rint(depth).astype(np.int32) % frame.num_bins]


@inline
def evidence(response, photons, squares, frame):
    """The score of a response."""
    table, steps, photons = frame.background_table, len(frame.background_table) - 1, max(photons, EPSILON)
    at = min(max(response / (photons * frame.max_response), ZERO), ONE) * F32(steps)
    low = min(int(at), steps - 1)
    rare = table[low] + (at - F32(low)) * (table[low + 1] - table[low])
    return photons / np.sqrt(max(squares, EPSILON)) * rare


@inline
def score_of(response, photons, frame):
    """The evidence of a pixel's photons, at least half of one."""
    photons = max(photons, HALF)
    return evidence(max(response, ZERO), photons, photons, frame)


@inline
def left(photons, explained):
    """The photons of a pixel without those that are explained, at least 1/2; 0 if it has seen none at all."""
    return max(photons - explained, HALF) if photons > ZERO else ZERO


@inline
def llr(score, response, photons, expected, likeness, frame):
    """Log-likelihood ratio, nats; `score_of` goes first, in a pass of its own: no vector register looks up a table."""
    seen = max(response, ZERO) / frame.total_energy
    likely = min(max(seen, expected / likeness), expected * likeness)
    deviance = likely - seen + (seen * log(seen / likely) if seen > ZERO else ZERO)
    signal = likely * frame.intensity_moments[0]
    background = max(max(photons, HALF) - likely, ZERO) * frame.intensity_moments[1]
    ratio = HALF * score * score - deviance * signal / (signal + background)
    return max(ratio, -DEAD) if photons <= ZERO else ratio
