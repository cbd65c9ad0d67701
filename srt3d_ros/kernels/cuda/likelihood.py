"""How much a pixel's own photons speak for a surface, as in `reference.likelihood`."""

import triton
import triton.language as tl

from srt3d_ros.kernels import constants

DEAD_PIXEL, LIKENESS = tl.constexpr(constants.DEAD_PIXEL), tl.constexpr(constants.LIKENESS)
SHARED_LIKENESS = tl.constexpr(constants.LIKENESS**2)


@triton.jit
def surprise(response, photons, max_response, background_table, STEPS: tl.constexpr):
    """ρ(response / photons), linear between the STEPS + 1 entries of the table."""
    at = tl.minimum(tl.maximum(response / (photons * max_response), 0.0), 1.0) * STEPS
    low = tl.minimum(at.to(tl.int32), STEPS - 1)
    below, above = tl.load(background_table + low), tl.load(background_table + low + 1)
    return below + (at - low.to(tl.float32)) * (above - below)


@triton.jit
def llr(response, photons, expected, likeness, total, max_response, background_table, moments, STEPS: tl.constexpr):
    """Log-likelihood ratio of "a surface of about this intensity and background" and "background alone", nats.

    Arguments are those of `llr` there. All must be finite, also where the result is not used:
    the response chooses an entry of `background_table`.
    """
    dead, response, photons = photons <= 0.0, tl.maximum(response, 0.0), tl.maximum(photons, 0.5)
    rare = surprise(response, photons, max_response, background_table, STEPS)
    seen = response / total
    likely = tl.minimum(tl.maximum(seen, expected / likeness), expected * likeness)
    some = seen > 0.0
    deviance = likely - seen + tl.where(some, seen * tl.log(tl.where(some, seen / likely, 1.0)), 0.0)
    signal = likely * tl.load(moments)
    background = tl.maximum(photons - likely, 0.0) * tl.load(moments + 1)
    ratio = 0.5 * photons * rare * rare - deviance * signal / (signal + background)
    return tl.where(dead, tl.maximum(ratio, DEAD_PIXEL), ratio)


@triton.jit
def left(photons, explained):
    """The photons of pixels without those that are explained, at least 1/2; 0 if they have seen none at all."""
    return tl.where(photons > 0.0, tl.maximum(photons - explained, 0.5), 0.0)
