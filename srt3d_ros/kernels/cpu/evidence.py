"""How much a pixel's own photons speak for its surfaces."""

import numpy as np
from numba import prange

from srt3d_ros.core.layout import DEPTH, INTENSITY
from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, ONE, ZERO, sincos, total_of
from srt3d_ros.kernels.cpu.compiling import inline, parallel

DEAD, LEFT = F32(constants.DEAD), F32(constants.LEFT)
LIKENESS, SHARING = F32(constants.LIKENESS), F32(constants.SHARING)


@inline
def nats(response, photons, expected, likeness, total, greatest, worth, moments):
    """Log-likelihood gain of "a surface of about this intensity and background" over "background alone".

    Two terms: how improbable it is that background photons respond like this (`worth`, Chernoff's bound), less how
    improbable the response is for the surface (half the deviance of the number of its photons, widened by the noise
    of the background).

    Args:
        response: of the pixel's photons to the matched filter at the surface's depth.
        photons: of the pixel, those of its other surfaces left out.
        expected: signal photons that the surface should give, to within the factor `likeness`.
        total, greatest, worth, moments: the Frame's total_energy, greatest_response, rarity and intensity_moments.
    """
    dead = photons <= ZERO
    response, photons = max(response, ZERO), max(photons, HALF)
    steps = len(worth) - 1
    at = min(response / (photons * greatest), ONE) * F32(steps)
    low = min(int(at), steps - 1)
    rare = worth[low] + (at - F32(low)) * (worth[low + 1] - worth[low])
    seen = response / total
    likely = min(max(seen, expected / likeness), expected * likeness)
    deviance = likely - seen + (seen * np.log(seen / likely) if seen > ZERO else ZERO)
    signal, background = likely * moments[0], max(photons - likely, ZERO) * moments[1]
    gain = HALF * photons * rare * rare - deviance * signal / (signal + background)
    return max(gain, DEAD) if dead else gain


@inline
def own_response(matched, exposure, energy, cycles, state, i, k, response):
    """Response of the pixels of row i to the matched filters of their surfaces k, their other surfaces taken out."""
    m, wide = len(energy), len(response)
    response[:] = ZERO
    for l in range(m):
        for j in range(wide):
            sine, cosine = sincos(cycles[l] * state[i, k, DEPTH, j])
            response[j] += matched[i, l, j] * cosine + matched[i, m + l, j] * sine
    for o in range(state.shape[1]):
        if o != k:
            for l in range(m):
                for j in range(wide):
                    _, apart = sincos(cycles[l] * (state[i, o, DEPTH, j] - state[i, k, DEPTH, j]))
                    response[j] -= state[i, o, INTENSITY, j] * exposure[i, j] * energy[l] * apart


@parallel
def _evidence(matched, noise, exposure, energy, cycles, greatest, worth, moments, state, out):
    tall, surfaces, _, wide = state.shape
    total = total_of(energy)
    for i in prange(tall):
        response = np.empty(wide, np.float32)
        for k in range(surfaces):
            own_response(matched, exposure, energy, cycles, state, i, k, response)
            for j in range(wide):
                out[i, k, j] = ZERO
                if state[i, k, INTENSITY, j] > ZERO and exposure[i, j] > ZERO:
                    others = ZERO
                    for o in range(surfaces):
                        others += state[i, o, INTENSITY, j] * exposure[i, j] if o != k else ZERO
                    photons = max(noise[i, j] - others, LEFT) if noise[i, j] > ZERO else ZERO
                    out[i, k, j] = nats(response[j], photons, state[i, k, INTENSITY, j] * exposure[i, j],
                                        SHARING if others > ZERO else LIKENESS, total, greatest, worth, moments)


def evidence(data, state, out=None):
    """Log-likelihood gain of every point by its own pixel's photons, nats.

    Args:
        data: the frame (see `srt3d_ros.core.frame.Frame`), padded.
        state: float32 [rows', K, FIELDS, cols'].

    Returns:
        float32 [rows', K, cols'], 0 where there is no point.
    """
    if out is None:
        out = np.empty((state.shape[0], state.shape[1], state.shape[3]), np.float32)
    _evidence(data.matched, data.noise, data.exposure, data.energy, data.cycles, F32(data.greatest_response),
              data.rarity, data.intensity_moments, state, out)
    return out
