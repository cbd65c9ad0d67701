"""Photons → sketch: sums_i = Σ_p exp(i ω_l x_p) over the photons p of pixel i, by adding table rows.

Sums are int64 [pixels, lanes] in units of 1 / UNIT, and exact: cosines and sines, interleaved, then the number
of photons in column 2m. The work is split between pixels, so no two threads add to the same pixel.

Memory read per photon of a sorted frame: 2 bytes of ToA, 4 of pixel index, and one row, 96 bytes up to m = 11. All rows
take 440 kB for T = 4,613 (they stay in the second-level cache) or 29 kB for T = 300 (in the first).

`add_run` is the inner loop: sums += Σ_p rows[x_p], where row x holds exp(i ω_l x) in units of 1 / UNIT. Integers add up
exactly, so a sketch has the same bits for every order of the photons, packets, threads and forms of input. Rounding a
row to 2⁻²⁴ costs as much precision as float32 has. A row is cut into parts of ROW_LANES values, whose sums stay in
registers: a vector of LANES and one of half as many.
"""

import numpy as np
from numba import int32, int64, prange, uint16, uint32

from srt3d_ros.kernels.constants import MAX_PIXEL_PHOTONS
from srt3d_ros.kernels.cpu.arithmetic import F32
from srt3d_ros.kernels.cpu.compiling import floats2d, inline, parallel, read_only
from srt3d_ros.kernels.cpu.device import zeros
from srt3d_ros.kernels.cpu.spans import span, spanning
from srt3d_ros.kernels.cpu.vectors import to_longs
from srt3d_ros.kernels.maps import LANES, MAX_ROWS, ROW_LANES, UNIT

rest_span = spanning(ROW_LANES - LANES)


def fixed_rows(table: np.ndarray) -> np.ndarray:
    """The rows that `add_run` reads, int32 [parts, T, ROW_LANES], of a table of values up to 1, float32 [T, C]."""
    height, values = table.shape
    wide = np.zeros((height, -(-values // ROW_LANES) * ROW_LANES), np.int32)
    wide[:, :values] = np.rint(table * np.float64(UNIT))
    rows = zeros(wide.shape[1] // ROW_LANES, height, ROW_LANES).view(np.int32)
    rows[:] = wide.reshape(height, -1, ROW_LANES).swapaxes(0, 1)
    return rows


@inline
def add_run(rows, toa, pixel, first, last, sums, to):
    """Add rows[toa[p]] of the photons from `first` on to pixel `to`, in place; returns where the run ends.

    A run has a photon or more, and ends where `pixel` changes, after MAX_ROWS photons, or at `last`. `pixel` is None if
    all photons are of one.
    """
    end = min(first + MAX_ROWS, last)
    for part in range(len(rows)):
        end = _add_part(rows, part, toa, pixel, first, end, sums, to)
    return end


@inline
def _add_part(rows, part, toa, pixel, first, last, sums, to):
    row, row_rest, at = span(0), rest_span(LANES), part * ROW_LANES
    begin, rest = rows[part, toa[first], row], rows[part, toa[first], row_rest]
    p, end = np.uint64(first + 1), np.uint64(last)      # unsigned: none counts from the end, which numba would look at
    while p < end:
        if pixel is not None and pixel[p] != to:
            end = p
        else:
            begin += rows[part, toa[p], row]
            rest += rows[part, toa[p], row_rest]
            p += np.uint64(1)
    sums[to, row + at] += to_longs(begin)
    sums[to, row_rest + at] += to_longs(rest)
    return np.int64(end)


THREAD_PHOTONS = 2**14      # fewer are not worth waking a thread
HISTOGRAMS = 2**7           # multiplied at a time: the fastest of 2⁵ to 2⁹ for 4,613 bins
TILE_PIXELS, TILE_CYCLES = 64, 128      # of a gated array, read at a time: 16 kB
PIXELS, TOA, WORDS = map(read_only, (uint32[::1], uint16[::1], uint16[:, ::1]))


def new_sums(pixels, rows):
    """Sums of 0, int64 [pixels, lanes], for rows of `fixed_rows`."""
    return np.zeros((pixels, len(rows) * ROW_LANES), np.int64)


@parallel
def _read_sums(sums: int64[:, ::1], out: floats2d, numbers: uint32[::1]):
    columns = out.shape[1]
    for i in prange(len(out)):
        number = max((sums[i, columns] + UNIT // 2) // UNIT, 0)     # rounded: counts minus a template have fractions
        numbers[i] = min(number, MAX_PIXEL_PHOTONS)
        scale = min(MAX_PIXEL_PHOTONS / max(number, 1), 1.0) / UNIT
        for c in range(columns):
            out[i, c] = F32(sums[i, c] * scale)


def read_sums(sums, m):
    """Sketches and photon counts of sums.

    Returns:
        Σ_p exp(i ω_l x_p) · min(1, MAX_PIXEL_PHOTONS / n), complex64 [pixels, m], and n, at most MAX_PIXEL_PHOTONS,
        uint32 [pixels].
    """
    out, numbers = np.empty((len(sums), 2 * m), np.float32), np.empty(len(sums), np.uint32)
    _read_sums(sums, out, numbers)
    return out.view(np.complex64), numbers


# ---- Events

@parallel
def _sketch_runs(pixel: PIXELS, toa: TOA, borders: int64[::1], rows: int32[:, :, ::1], sums: int64[:, ::1]):
    for part in prange(len(borders) - 1):
        p, last = borders[part], borders[part + 1]
        while p < last:
            p = add_run(rows, toa, pixel, p, last, sums, pixel[p])


def sketch_events(pixel, toa, rows, ordered, sums):
    """Add the row of each photon to its pixel, in place: sums[pixel_p] += rows[x_p].

    Args:
        pixel: uint32 [N], below the number of pixels.
        toa: uint16 [N], x_p, below the number of rows.
        rows: int32 [parts, T, ROW_LANES] of `fixed_rows`.
        ordered: whether `pixel` never decreases; otherwise one thread adds the photons.
    """
    number, parts = len(pixel), min(64, 1 + len(pixel) // THREAD_PHOTONS) if ordered else 1
    before = pixel[np.arange(1, parts) * number // parts - 1]
    borders = np.array([0, *np.searchsorted(pixel, before, "right"), number])
    _sketch_runs(pixel, toa, borders, rows, sums)


# ---- Gates

@parallel
def _sketch_gates(words: WORDS, rows: int32[:, :, ::1], first_word: uint16, no_detection: uint16, sums: int64[:, ::1]):
    gates, pixels = words.shape
    for strip in prange((pixels + TILE_PIXELS - 1) // TILE_PIXELS):
        toa, first_pixel = np.empty(TILE_CYCLES, np.uint16), strip * TILE_PIXELS
        for first in range(0, gates, TILE_CYCLES):      # a tile stays in the cache while its columns are read
            tile = words[first:first + TILE_CYCLES, first_pixel:first_pixel + TILE_PIXELS]
            for column in range(tile.shape[1]):
                found = np.uint32(0)
                for cycle in range(len(tile)):          # always written, overwritten if it is no photon: no branch
                    toa[found] = tile[cycle, column] - first_word
                    found += np.uint32(tile[cycle, column] != no_detection)
                if found > 0:
                    add_run(rows, toa, None, 0, np.int64(found), sums, first_pixel + column)


def sketch_gates(words, rows, first_word, no_detection, sums):
    """Add the rows of a gated array's photons to their pixels, in place.

    A word is one pixel's result in one laser cycle: `no_detection`, or a photon x = word − `first_word`, below T.
    `words` are uint16 [cycles, pixels].
    """
    _sketch_gates(words, rows, np.uint16(first_word), np.uint16(no_detection), sums)


# ---- Histograms

def sketch_histograms(counts, table, of_template, sums):
    """Add histograms to their pixels, in place: sums_i += Σ_j counts_ij table_j − of_template.

    A product of matrices in float32, computed by BLAS on its own threads: its cost does not depend on the counts.

    Args:
        counts: uint8, uint16, int32 or float32 [pixels, n].
        table: float32 [n, 2m + 2], exp(i ω_l b), real and imaginary parts interleaved, then 1 and 0; zeros for
            bins that do not count.
        of_template: float32 [2m + 2] or [pixels, 2m + 2], or None.
    """
    pixels, n = counts.shape
    as_float = np.empty((min(HISTOGRAMS, pixels), n), np.float32)       # fits into the cache; a whole frame does not
    for first in range(0, pixels, HISTOGRAMS):
        part = slice(first, min(first + HISTOGRAMS, pixels))
        of_part = as_float[:part.stop - first]
        of_part[:] = counts[part]
        product = of_part @ table
        if of_template is not None:
            product -= of_template if of_template.ndim == 1 else of_template[part]
        sums[part, :product.shape[1]] += np.rint(product * np.float64(UNIT)).astype(np.int64)
