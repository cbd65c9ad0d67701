"""Trims outlines: the points of rims that their own photons do not pay for are removed.

Two kernels a round, so that points may go while their neighbours' photons are read: one writes what the pixels of rims
see, the other adds it up. Both read little, and few pixels are at rims.
"""

import triton
import triton.language as tl

from srt3d_ros.kernels import constants, maps
from srt3d_ros.kernels.constants import SPREAD
from srt3d_ros.kernels.cuda.device import borrow
from srt3d_ros.kernels.cuda.likelihood import llr, surprise
from srt3d_ros.kernels.cuda.maps import (
    BLOCK,
    COUNTS,
    DEPTH,
    EXPOSURE,
    INTENSITY,
    MARGIN,
    TERMS,
    VALUE,
    record_of,
    surface_count,
)

RIM = tl.constexpr(constants.RIM)


@triton.jit
def _mark(exposure, state, terms, period, rim, padded_cols, SURFACES: tl.constexpr, BLOCK: tl.constexpr):
    """Write response, photons and expected photons of the pixels at rims, 0 elsewhere."""
    i, j = tl.program_id(1) + MARGIN, MARGIN + tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    blank, there = tl.zeros([BLOCK], tl.int32), surface_count(state, i, j, padded_cols, period, SURFACES) > 0
    for n in range(9):
        a, b = i + n // 3 - 1, j + n % 3 - 1
        used = tl.load(exposure + a * padded_cols + b) > 0.0
        blank += (used & (surface_count(state, a, b, padded_cols, period, SURFACES) == 0)).to(tl.int32)
    response, photons, expected = tl.zeros([BLOCK], tl.float32), tl.zeros([BLOCK], tl.float32), tl.zeros(
        [BLOCK], tl.float32)
    for k in tl.static_range(SURFACES):
        intensity = tl.load(record_of(state, i, k, j, padded_cols, SURFACES) + INTENSITY * padded_cols)
        counted = there & (blank >= RIM) & (intensity > 0.0)
        term = terms + (i * SURFACES + k) * TERMS * padded_cols + j
        response += tl.where(counted, tl.load(term + VALUE * padded_cols), 0.0)
        photons += tl.where(counted, tl.load(term + COUNTS * padded_cols), 0.0)
        expected += tl.where(counted, tl.load(term + EXPOSURE * padded_cols) * intensity, 0.0)
    place = rim + i * 3 * padded_cols + j
    tl.store(place, response)
    tl.store(place + padded_cols, photons)
    tl.store(place + 2 * padded_cols, expected)


@triton.jit
def _drop(rim, clutter, total, max_response, background_table, moments, enough, state, padded_cols,
          SIDE: tl.constexpr, CLUTTER: tl.constexpr, STEPS: tl.constexpr, SURFACES: tl.constexpr, BLOCK: tl.constexpr):
    i, j = tl.program_id(1) + MARGIN, MARGIN + tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    at_rim = tl.load(rim + (i * 3 + 2) * padded_cols + j) > 0.0
    if tl.max(at_rim.to(tl.int32), axis=0) > 0:
        response, photons, expected = tl.zeros([BLOCK], tl.float32), tl.zeros([BLOCK], tl.float32), tl.zeros(
            [BLOCK], tl.float32)
        for n in range(SIDE * SIDE):
            place = rim + (i + n // SIDE - SIDE // 2) * 3 * padded_cols + j + n % SIDE - SIDE // 2
            response += tl.load(place)
            photons += tl.load(place + padded_cols)
            expected += tl.load(place + 2 * padded_cols)
        some = tl.maximum(photons, 0.5)
        score = tl.sqrt(some) * surprise(tl.maximum(response, 0.0), some, max_response, background_table, STEPS)
        ratio = llr(response, photons, tl.where(at_rim, expected, 1.0), 1.0, total, max_response, background_table,
                    moments, STEPS)
        for k in tl.static_range(SURFACES):
            record = record_of(state, i, k, j, padded_cols, SURFACES)
            needed = tl.zeros([BLOCK], tl.float32) + enough
            if CLUTTER > 0:
                nearest = tl.floor(tl.load(record + DEPTH * padded_cols) + 0.5).to(tl.int32) % CLUTTER
                needed = needed * tl.load(clutter + nearest)
            unpaid = at_rim & (ratio < 0.0) & (score <= needed)
            tl.store(record + INTENSITY * padded_cols, tl.zeros([BLOCK], tl.float32), mask=unpaid)


def trim(frame, state, terms, enough, scratch=None):
    padded_rows, surfaces, _, padded_cols = state.shape
    rim = borrow(scratch, "rim", (padded_rows, 3, padded_cols), True)
    grid = (padded_cols - 2 * maps.MARGIN) // maps.BLOCK, padded_rows - 2 * maps.MARGIN
    flat = frame.clutter is None
    for _ in range(SPREAD):
        _mark[grid](frame.exposure, state, terms, float(frame.num_bins), rim, padded_cols, SURFACES=surfaces,
                    BLOCK=BLOCK, num_warps=1)
        _drop[grid](rim, frame.counts if flat else frame.clutter, frame.total_energy, frame.max_response,
                    frame.background_table, frame.intensity_moments, enough, state, padded_cols,
                    SIDE=2 * constants.VOTE_RADIUS + 1, CLUTTER=0 if flat else len(frame.clutter),
                    STEPS=len(frame.background_table) - 1, SURFACES=surfaces, BLOCK=BLOCK, num_warps=1)
