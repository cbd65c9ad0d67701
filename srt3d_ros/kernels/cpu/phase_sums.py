"""Photons → sketch: rows of a table, or of cosines, add up per pixel.

Sums are int64 [pixels, lanes] in units of 1 / UNIT and exact (rows.py). The work is cut at borders between pixels, so
that no two threads add to one pixel. Per photon of a sorted frame the kernels read 6 bytes (uint16 ToA) and one row,
80 bytes for m = 10: 370 kB for T = 4,613, which stay in the second-level cache, 24 kB for T = 300, in the first.
"""

import numpy as np
from numba import get_num_threads, prange

from srt3d_ros.kernels.constants import MAX_PHOTONS
from srt3d_ros.kernels.cpu.arithmetic import F32, polynomial
from srt3d_ros.kernels.cpu.compiling import inline, parallel
from srt3d_ros.kernels.cpu.rows import UNIT, add_run, lanes

PART = 2**14        # photons that are worth a thread
BLOCK = 2**21       # unsorted photons that are sorted together
STRIPS = 8          # of a block, sorted in parallel, at most: each takes 4 bytes a pixel
ROWS = 2**7         # histograms at a time: of 2⁵ to 2⁹ these were fastest for 4,613 bins
WIDE, CYCLES = 64, 128      # pixels and cycles of a gated array that are read together, 16 kB
TURN = 2**32

# −sin(2πx) / x · UNIT as a polynomial in x² on |x| ≤ 1/4, largest error 7e-9 of UNIT (Chebyshev interpolation)
_SIN = tuple(F32(-UNIT * c) for c in (6.28318528, -41.3416807, 81.6024807, -76.5812846, 39.7607221))


def new_sums(pixels, values):
    """Empty sums of `values` = 2m numbers for each pixel, and numbers of photons, int64 [pixels]."""
    return np.zeros((pixels, lanes(values)), np.int64), np.zeros(pixels, np.int64)


@parallel
def _read_sums(sums, photons, out, numbers):
    for i in prange(len(out)):
        number = max(photons[i], 1)
        numbers[i] = min(photons[i], MAX_PHOTONS)
        scale = min(MAX_PHOTONS / number, 1.0) / UNIT
        for c in range(out.shape[1]):
            out[i, c] = F32(sums[i, c] * scale)


def read_sums(sums, photons, values):
    """Σ_p exp(i ω_l x_p) · min(1, MAX_PHOTONS / n), complex64 [pixels, m], and min(n, MAX_PHOTONS), uint32.

    `values` may be less than the sums have: the first count.
    """
    out, numbers = np.empty((len(sums), values), np.float32), np.empty(len(sums), np.uint32)
    _read_sums(sums, photons, out, numbers)
    return out.view(np.complex64), numbers


def counted(sums, column):
    """Photons whose row has a 1 in this column, where all others have 0 there; int64 [pixels]."""
    return (sums[:, column] + UNIT // 2) // UNIT        # cosines of times with fractions may be a unit off


# ---- Photons in any order: a counting sort first

@parallel
def _sort(pixel, toa, place):
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


def _sorted_blocks(pixel, toa, pixels):
    """ToA of blocks of photons, by pixel, and where those of each pixel end, uint32 [pixels]."""
    block, strips = max(BLOCK, 8 * pixels), min(get_num_threads(), STRIPS)
    for first in range(0, len(pixel), block):
        place = np.zeros((strips, pixels), np.uint32)
        yield _sort(pixel[first:first + block], toa[first:first + block], place), place[-1]


# ---- Events: a table row for each photon

@parallel
def _sketch_sorted(pixel, toa, borders, rows, sums, photons):
    for part in prange(len(borders) - 1):
        p, last = borders[part], borders[part + 1]
        while p < last:
            i, first = pixel[p], p
            p = add_run(rows, toa, pixel, first, last, sums[i])
            photons[i] += p - first


@parallel
def _sketch_pixels(toa, ends, rows, sums, photons):
    for i in prange(len(ends)):
        p, last = np.int64(ends[i - 1]) if i > 0 else 0, np.int64(ends[i])
        photons[i] += last - p
        while p < last:
            p = add_run(rows, toa, None, p, last, sums[i])


def sketch_events(pixel, toa, rows, ordered, sums, photons):
    """sums[pixel_p] += rows[x_p], photons[pixel_p] += 1, in place.

    Args:
        pixel: uint32 [N], below the number of pixels.
        toa: uint16 [N], below T.
        rows: of `fixed_rows`.
        ordered: whether `pixel` never decreases.
    """
    if ordered:
        number, parts = len(pixel), min(64, 1 + len(pixel) // PART)
        before = pixel[np.arange(1, parts) * number // parts - 1]
        borders = np.array([0, *np.searchsorted(pixel, before, "right"), number])
        _sketch_sorted(pixel, toa, borders, rows, sums, photons)
    else:
        for block in _sorted_blocks(pixel, toa, len(sums)):
            _sketch_pixels(*block, rows, sums, photons)


# ---- ToA with fractions: the cosines of each photon

@inline
def _cosine(turns):
    """cos of 2π · turns / TURN · UNIT; uint32."""
    phase = np.int32(turns)
    x = F32(np.int32(abs(phase) - np.int32(TURN // 4))) * F32(1 / TURN)           # cos p = −sin(|p| − 1/4 turn)
    return np.int32(np.rint(polynomial(x * x, _SIN) * x))


@parallel
def _sketch_continuous(toa, ends, turns_per_bin, cycles, lead, sums, photons):
    values = len(cycles)
    for i in prange(len(ends)):
        row, first, last = np.empty(values, np.int32), np.int64(ends[i - 1]) if i > 0 else 0, np.int64(ends[i])
        photons[i] += last - first
        for p in range(first, last):
            turns = np.uint32(np.int64(np.rint(toa[p] * turns_per_bin)))
            for c in range(values):                     # two loops: numbers of one size run in vector registers
                row[c] = _cosine(cycles[c] * turns + lead[c])
            for c in range(values):
                sums[i, c] += row[c]


def sketch_continuous(pixel, toa, frequencies, num_bins, ordered, sums, photons):
    """sums[pixel_p] += exp(2πi k_l x_p / T), photons[pixel_p] += 1, for times x, float32 bins, with fractions.

    x / T is rounded to 2⁻³³, 2⁸ times finer than float32 is near T: phases err by less than 2π k · 2⁻³³.
    """
    cycles = np.repeat(np.asarray(frequencies, np.uint32), 2)
    lead = np.tile(np.array([0, 3 * TURN // 4], np.uint32), len(frequencies))           # sin p = cos(p + 3/4 turn)
    if ordered:
        blocks = [(toa, np.bincount(pixel, minlength=len(sums)).cumsum().astype(np.uint32))]
    else:
        blocks = _sorted_blocks(pixel, toa, len(sums))
    for block in blocks:
        _sketch_continuous(*block, TURN / num_bins, cycles, lead, sums, photons)


# ---- Gates

@parallel
def find_stray(words, first_word, no_detection, num_bins):
    """The highest word, of uint16 [G · pixels], that is neither `no_detection` nor `first_word` + a bin; else −1."""
    stray = np.int32(-1)
    for p in prange(len(words)):
        bin_number = np.int32(words[p]) - np.int32(first_word)
        bad = (words[p] != no_detection) & ((bin_number < 0) | (bin_number >= num_bins))
        stray = max(stray, np.int32(words[p]) if bad else np.int32(-1))
    return stray


@parallel
def _sketch_gates(words, rows, first_word, no_detection, sums, photons):
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
                photons[strip * WIDE + p] += found


def sketch_gates(words, rows, first_word, no_detection, sums, photons):
    """As `sketch_events`, for the photons x = word − `first_word` of all words that are not `no_detection`.

    `words` are uint16 [G, pixels], a laser cycle a row, without stray ones.
    """
    _sketch_gates(words, rows, np.uint16(first_word), np.uint16(no_detection), sums, photons)


# ---- Histograms: a product of matrices, by BLAS, with its threads

def sketch_histograms(counts, table, of_template, sums, photons):
    """sums_i += Σ_j counts_ij table_j − of_template, and its last column but one, if above 0, to photons_i.

    In float32: what it costs does not depend on the counts. `sums` may be of 2m values only, then what is behind them
    counts for `photons` alone.

    Args:
        counts: uint8, uint16, int32 or float32 [pixels, n].
        table: float32 [n, 2m + 2] of exp(i ω_l b), re and im interleaved, then 1 and 0; zeros for bins that do not
            count.
        of_template: float32 [2m + 2] or [pixels, 2m + 2], or None.
    """
    pixels, n = counts.shape
    wanted = min(sums.shape[1], table.shape[-1])
    as_float = np.empty((min(ROWS, pixels), n), np.float32)         # a part in the cache instead of a frame in memory
    for first in range(0, pixels, ROWS):
        part = slice(first, min(first + ROWS, pixels))
        of_part = as_float[:part.stop - first]
        of_part[:] = counts[part]
        product = of_part @ table
        if of_template is not None:
            product -= of_template if of_template.ndim == 1 else of_template[part]
        sums[part, :wanted] += np.rint(product[:, :wanted] * np.float64(UNIT)).astype(np.int64)
        photons[part] += np.rint(np.maximum(product[:, -2], 0)).astype(np.int64)
