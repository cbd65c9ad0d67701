"""How much a pixel's own photons speak for its surfaces. Per pixel and surface 12 bytes are read and 4 written."""

import triton
import triton.language as tl

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cuda.device import borrow
from srt3d_ros.kernels.cuda.maps import BLOCK, FIELDS, INTENSITY, TERMS, VALUE

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

    Arguments are those of `llr` in kernels/cpu/likelihood.py. All must be finite, also where the result is not used:
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


@triton.jit
def _log_likelihood_ratio(counts, exposure, total, max_response, background_table, moments, state, terms, out,
                          padded_cols, STEPS: tl.constexpr, SURFACES: tl.constexpr, BLOCK: tl.constexpr):
    i, j = tl.program_id(1), tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    inside = j < padded_cols
    seen = tl.load(exposure + i * padded_cols + j, mask=inside, other=0.0)
    photons = tl.load(counts + i * padded_cols + j, mask=inside, other=0.0)
    intensity = state + (i * SURFACES * FIELDS + INTENSITY) * padded_cols + j
    response = terms + (i * SURFACES * TERMS + VALUE) * padded_cols + j
    everything = tl.zeros_like(seen)
    for k in tl.static_range(SURFACES):
        everything += tl.load(intensity + k * FIELDS * padded_cols, mask=inside, other=0.0) * seen
    for k in tl.static_range(SURFACES):
        expected = tl.load(intensity + k * FIELDS * padded_cols, mask=inside, other=0.0) * seen
        shown = tl.load(response + k * TERMS * padded_cols, mask=inside, other=0.0)
        others, there = everything - expected, expected > 0.0
        ratio = llr(shown, left(photons, others), tl.where(there, expected, 1.0),
                    tl.where(others > 0.0, SHARED_LIKENESS, LIKENESS), total, max_response, background_table, moments,
                    STEPS)
        tl.store(out + (i * SURFACES + k) * padded_cols + j, tl.where(there, ratio, 0.0), mask=inside)


def log_likelihood_ratio(frame, state, terms, scratch=None):
    padded_rows, surfaces, _, padded_cols = state.shape
    out = borrow(scratch, "log_likelihood_ratio", (padded_rows, surfaces, padded_cols))
    _log_likelihood_ratio[triton.cdiv(padded_cols, BLOCK.value), padded_rows](
        frame.counts, frame.exposure, frame.total_energy, frame.max_response, frame.background_table,
        frame.intensity_moments, state, terms, out, padded_cols, STEPS=len(frame.background_table) - 1,
        SURFACES=surfaces, BLOCK=BLOCK, num_warps=1)
    return out
