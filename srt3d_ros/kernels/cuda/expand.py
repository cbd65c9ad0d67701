"""The data term of every point, to second order at the depth that it shows, and sums of such terms.

A thread owns a point. Per point 8m + 20 bytes are read, 24 written, and a sine and a cosine of each frequency taken: at
m = 10 some 400 operations and 124 bytes, so that memory sets the pace.
"""

import triton
import triton.language as tl

from srt3d_ros.kernels.cuda.arithmetic import TURN, sincos
from srt3d_ros.kernels.cuda.maps import (
    COUNTS,
    CURVATURE,
    DEPTH,
    EXPOSURE,
    GRADIENT,
    INTENSITY,
    SQUARES,
    TERMS,
    TILE_ROWS,
    VALUE,
    tile_pixels,
    tiles,
)
from srt3d_ros.kernels.cuda.scratch import borrow
from srt3d_ros.kernels.cuda.surfaces import record_of


@triton.jit
def store_terms(into, terms, mask, padded_cols):
    """Write terms, in the order of `maps`; 0 outside the mask."""
    for term in tl.static_range(TERMS):
        tl.store(into + term * padded_cols, tl.where(mask, terms[term], 0.0))


@triton.jit
def add_terms(sums, bends, shown, weight, e, dy, dx, padded_cols, CELLS: tl.constexpr):
    """Add weighted terms, each moved from its surface's depth to a plane, e bins away, (dy, dx) pixels from its point.

    Args:
        sums: of the terms, in the order of `maps`.
        bends: sums of curvature times dx, and times dy, by which the gradient changes when the plane is turned; and
            times e².
        shown: pointers to the terms.
        CELLS: whether they are of cells; of one pixel SQUARES and COUNTS are the same.
    """
    value, gradient, curvature, squares, counts, exposure = sums
    bend_col, bend_row, off_plane = bends
    bend = weight * tl.load(shown + CURVATURE * padded_cols)
    rise = weight * tl.load(shown + GRADIENT * padded_cols)
    photons = tl.load(shown + COUNTS * padded_cols)
    photons2 = tl.load(shown + SQUARES * padded_cols) if CELLS else photons
    light = tl.load(shown + EXPOSURE * padded_cols)
    sums = (value + weight * tl.load(shown + VALUE * padded_cols) - e * (rise + 0.5 * e * bend),
            gradient + rise + e * bend, curvature + bend, squares + weight * weight * photons2,
            counts + weight * photons, exposure + weight * light)
    return sums, (bend_col + bend * dx, bend_row + bend * dy, off_plane + bend * e * e)


@triton.jit
def _expand(matched, counts, exposure, energy, bin_frequencies, state, terms, padded_rows, padded_cols, m,
            SURFACES: tl.constexpr):
    k = tl.program_id(2)
    i, j = tile_pixels(padded_rows)
    record = record_of(state, i, k, j, padded_cols, SURFACES)
    depth, light = tl.load(record + DEPTH * padded_cols), tl.load(exposure + i * padded_cols + j)
    sketch = matched + i * 2 * m * padded_cols + j
    value, gradient, curvature = tl.zeros_like(depth), tl.zeros_like(depth), tl.zeros_like(depth)
    for l in tl.range(m, loop_unroll_factor=5):
        frequency = tl.load(bin_frequencies + l)
        omega = frequency * TURN
        re, im = tl.load(sketch + l * padded_cols), tl.load(sketch + (m + l) * padded_cols)
        sine, cosine = sincos(frequency * depth)
        along = re * cosine + im * sine
        value += along
        gradient += omega * (im * cosine - re * sine)
        curvature += omega * omega * along
    for step in tl.static_range(1, SURFACES):           # what the pixel's other surfaces explain
        other = record_of(state, i, (k + step) % SURFACES, j, padded_cols, SURFACES)
        apart = tl.load(other + DEPTH * padded_cols) - depth
        photons = tl.load(other + INTENSITY * padded_cols) * light
        for l in tl.range(m, loop_unroll_factor=5):
            frequency = tl.load(bin_frequencies + l)
            omega, known = frequency * TURN, photons * tl.load(energy + l)
            sine, cosine = sincos(frequency * apart)
            value -= known * cosine
            gradient -= omega * known * sine
            curvature -= omega * omega * known * cosine

    photons = tl.load(counts + i * padded_cols + j)
    store_terms(terms + (i * SURFACES + k) * TERMS * padded_cols + j,
                (value, gradient, curvature, photons, photons, light),
                tl.load(record + INTENSITY * padded_cols) > 0.0, padded_cols)


def expand(frame, state, scratch=None):
    """A program per tile and surface."""
    padded_rows, surfaces, _, padded_cols = state.shape
    terms = borrow(scratch, "terms", (padded_rows, surfaces, TERMS.value, padded_cols), scratch is None)
    _expand[(*tiles(padded_rows, padded_cols), surfaces)](
        frame.matched, frame.counts, frame.exposure, frame.energy, frame.bin_frequencies, state, terms, padded_rows,
        padded_cols, len(frame.energy), SURFACES=surfaces, num_warps=TILE_ROWS)
    return terms
