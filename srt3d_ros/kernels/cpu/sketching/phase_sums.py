"""Photons → sketch: rows of a table add up per pixel.

Sums are int64 [pixels, lanes] in units of 1 / UNIT and exact (rows.py): of cosines and sines, and, in column 2m, of the
photons themselves. The work is cut at borders between pixels, so that no two threads add to one pixel. Per photon of a
sorted frame the kernels read 6 bytes (uint16 ToA) and one row, 96 bytes up to m = 11: 440 kB for T = 4,613, which stay
in the second-level cache, 29 kB for T = 300, in the first.
"""

import numpy as np
from numba import float32, get_num_threads, int32, int64, prange, uint16, uint32

from srt3d_ros.kernels.constants import MAX_PHOTONS
from srt3d_ros.kernels.cpu.arithmetic import F32
from srt3d_ros.kernels.cpu.compiling import parallel, read_only
from srt3d_ros.kernels.cpu.sketching.rows import LANES, UNIT, add_run

PART = 2**14        # photons that are worth a thread
BLOCK = 2**21       # unsorted photons that are sorted together
STRIPS = 8          # of a block, sorted in parallel, at most: each takes 4 bytes a pixel
ROWS = 2**7         # histograms at a time: of 2⁵ to 2⁹ these were fastest for 4,613 bins
WIDE, CYCLES = 64, 128      # pixels and cycles of a gated array that are read together, 16 kB
PIXELS, TOA, WORDS = map(read_only, (uint32[::1], uint16[::1], uint16[:, ::1]))


def new_sums(pixels, rows):
    """Empty sums of such rows for each pixel."""
    return np.zeros((pixels, len(rows) * LANES), np.int64)


@parallel
def _read_sums(sums: int64[:, ::1], out: float32[:, ::1], numbers: uint32[::1]):
    counts = out.shape[1]
    for i in prange(len(out)):
        number = max((sums[i, counts] + UNIT // 2) // UNIT, 0)      # of counts less a template there may be fractions
        numbers[i] = min(number, MAX_PHOTONS)
        scale = min(MAX_PHOTONS / max(number, 1), 1.0) / UNIT
        for c in range(out.shape[1]):
            out[i, c] = F32(sums[i, c] * scale)


def read_sums(sums, m):
    """Σ_p exp(i ω_l x_p) · min(1, MAX_PHOTONS / n), complex64 [pixels, m], and n, 0 to MAX_PHOTONS, uint32 [pixels]."""
    out, numbers = np.empty((len(sums), 2 * m), np.float32), np.empty(len(sums), np.uint32)
    _read_sums(sums, out, numbers)
    return out.view(np.complex64), numbers


# ---- Photons in any order: a counting sort first

@parallel
def _sort(pixel: PIXELS, toa: TOA, place: uint32[:, ::1]):
    """ToA by pixel. `place` [strips, pixels], 0: of a strip of photons how many are a pixel's, then where they end."""
    number, strips = len(pixel), len(place)
    in_order = np.empty_like(toa)
    for strip in prange(strips):
        own, counts = pixel[strip * number // strips:(strip + 1) * number // strips], place[strip]
        for p in range(len(own)):
            counts[own[p]] += np.uint32(1)
    total = np.uint32(0)
    for i in range(place.shape[1]):
        for strip in range(strips):
            total, place[strip, i] = total + place[strip, i], total
    for strip in prange(strips):
        first, last = strip * number // strips, (strip + 1) * number // strips
        own, own_toa, to = pixel[first:last], toa[first:last], place[strip]
        for p in range(len(own)):
            at = to[own[p]]
            in_order[at] = own_toa[p]
            to[own[p]] = at + np.uint32(1)
    return in_order


# ---- Events: a table row for each photon

@parallel
def _sketch_sorted(pixel: PIXELS, toa: TOA, borders: int64[::1], rows: int32[:, :, ::1], sums: int64[:, ::1]):
    for part in prange(len(borders) - 1):
        p, last = borders[part], borders[part + 1]
        while p < last:
            p = add_run(rows, toa, pixel, p, last, sums[pixel[p]])


@parallel
def _sketch_pixels(toa: uint16[::1], ends: uint32[::1], rows: int32[:, :, ::1], sums: int64[:, ::1]):
    for i in prange(len(ends)):
        p, last = np.int64(ends[i - 1]) if i > 0 else 0, np.int64(ends[i])
        while p < last:
            p = add_run(rows, toa, None, p, last, sums[i])


def sketch_events(pixel, toa, rows, ordered, sums):
    """sums[pixel_p] += rows[x_p], in place.

    Args:
        pixel: uint32 [N], below the number of pixels.
        toa: uint16 [N], rows.
        rows: of `fixed_rows`.
        ordered: whether `pixel` never decreases.
    """
    if ordered:
        number, parts = len(pixel), min(64, 1 + len(pixel) // PART)
        before = pixel[np.arange(1, parts) * number // parts - 1]
        borders = np.array([0, *np.searchsorted(pixel, before, "right"), number])
        _sketch_sorted(pixel, toa, borders, rows, sums)
    else:
        block, strips = max(BLOCK, 8 * len(sums)), min(get_num_threads(), STRIPS)
        for first in range(0, len(pixel), block):
            place = np.zeros((strips, len(sums)), np.uint32)
            in_order = _sort(pixel[first:first + block], toa[first:first + block], place)
            _sketch_pixels(in_order, place[-1], rows, sums)


# ---- Gates

@parallel
def _sketch_gates(words: WORDS, rows: int32[:, :, ::1], first_word: uint16, no_detection: uint16, sums: int64[:, ::1]):
    gates, pixels = words.shape
    for strip in prange((pixels + WIDE - 1) // WIDE):
        toa = np.empty(CYCLES, np.uint16)
        for first in range(0, gates, CYCLES):           # words that stay in the cache while pixel after pixel is read
            tile = words[first:first + CYCLES, strip * WIDE:(strip + 1) * WIDE]
            for p in range(tile.shape[1]):
                found = np.uint32(0)
                for g in range(len(tile)):              # written always, kept if it is a photon: no branch to guess
                    toa[found] = tile[g, p] - first_word
                    found += np.uint32(tile[g, p] != no_detection)
                add_run(rows, toa, None, 0, np.int64(found), sums[strip * WIDE + p])


def sketch_gates(words, rows, first_word, no_detection, sums):
    """As `sketch_events`, for the photons x = word − `first_word` of all words that are not `no_detection`.

    `words` are uint16 [G, pixels], a laser cycle a row, without stray ones.
    """
    _sketch_gates(words, rows, np.uint16(first_word), np.uint16(no_detection), sums)


# ---- Histograms: a product of matrices, by BLAS, with its threads

def sketch_histograms(counts, table, of_template, sums):
    """sums_i += Σ_j counts_ij table_j − of_template, in float32: what it costs does not depend on the counts.

    Args:
        counts: uint8, uint16, int32 or float32 [pixels, n].
        table: float32 [n, 2m + 2] of exp(i ω_l b), re and im interleaved, then 1 and 0; zeros for bins that do not
            count.
        of_template: float32 [2m + 2] or [pixels, 2m + 2], or None.
    """
    pixels, n = counts.shape
    as_float = np.empty((min(ROWS, pixels), n), np.float32)         # a part in the cache instead of a frame in memory
    for first in range(0, pixels, ROWS):
        part = slice(first, min(first + ROWS, pixels))
        of_part = as_float[:part.stop - first]
        of_part[:] = counts[part]
        product = of_part @ table
        if of_template is not None:
            product -= of_template if of_template.ndim == 1 else of_template[part]
        sums[part, :product.shape[1]] += np.rint(product * np.float64(UNIT)).astype(np.int64)
