"""Photons → sketch: rows of a table, or of cosines, add up per pixel.

Sums are int64 [pixels, lanes] in units of 1 / UNIT and exact (rows.py). The work is cut at borders between pixels, so
that no two threads add to one pixel. Per photon of a sorted frame the kernels read 6 bytes (uint16 ToA) and one row,
80 bytes for m = 10: 370 kB for T = 4,613, which stay in the second-level cache, 24 kB for T = 300, in the first.
"""

import numpy as np
from numba import get_num_threads, prange

from srt3d_ros.kernels.constants import MAX_PHOTONS
from srt3d_ros.kernels.cpu.arithmetic import F32
from srt3d_ros.kernels.cpu.compiling import inline, parallel, serial
from srt3d_ros.kernels.cpu.rows import LANES, UNIT, add_run, aligned, lanes

PART = 2**14        # photons that are worth a thread
BLOCK = 2**21       # unsorted photons that are sorted together: 4 MB of scratch
STRIPS = 8          # of a block, sorted in parallel, at most: each takes 4 bytes a pixel
WIDE, CYCLES = 64, 128      # pixels and cycles of a gated array that are read together, 16 kB
TURN = 2**32
TILE = 2**8         # photons whose cosines a thread computes

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


# ---- Checks: a pass of its own, so that nothing is added if one photon is bad. It takes a tenth of the time.

@parallel
def _inspect_events(pixel, toa, pixels, num_bins, found):
    photons, parts = len(pixel), len(found)
    for part in prange(parts):
        first, last = part * photons // parts, (part + 1) * photons // parts
        highest, outside, drops = np.uint32(0), np.uint32(0), np.uint32(0)
        own, own_toa, before = pixel[first:last], toa[first:last], pixel[max(first, 1) - 1:last]
        for p in range(len(own)):
            highest = max(highest, own[p])
        for p in range(len(before) - 1):
            drops |= np.uint32(before[p + 1] < before[p])
        for p in range(len(own_toa)):
            outside |= np.uint32(not (own_toa[p] >= 0 and own_toa[p] < num_bins))
        found[part, 0] = outside > 0 or highest >= pixels
        found[part, 1] = drops > 0


def inspect_events(pixel, toa, pixels, num_bins):
    """Whether all photons have a pixel below `pixels` and 0 ≤ x < T, and whether `pixel` never decreases."""
    found = np.empty((_parts(len(pixel)), 2), np.bool_)
    _inspect_events(pixel, toa, pixels, toa.dtype.type(num_bins), found)
    outside, unsorted = found.any(axis=0)
    return not outside, not unsorted


@parallel
def _find_stray(words, first_word, no_detection, num_bins, stray):
    parts = len(stray)
    for part in prange(parts):
        highest = np.int32(-1)
        own = words[part * len(words) // parts:(part + 1) * len(words) // parts]
        for p in range(len(own)):
            b = np.int32(own[p]) - np.int32(first_word)
            bad = own[p] != no_detection and (b < 0 or b >= num_bins)
            highest = max(highest, np.int32(own[p]) if bad else np.int32(-1))
        stray[part] = highest


def find_stray(words, first_word, no_detection, num_bins):
    """The highest word, of uint16 [G, pixels], that is neither `no_detection` nor `first_word` + a bin; else −1."""
    stray = np.full(_parts(words.size), -1, np.int32)
    _find_stray(words.reshape(-1), first_word, np.uint16(no_detection), num_bins, stray)
    return int(stray.max())


def _parts(photons):
    return min(64, 1 + photons // PART)


# ---- Photons that are sorted by pixel

@serial
def _border(pixel, first):
    """The first photon from here on that is not of the pixel of the photon before."""
    if first == 0:
        return 0
    low, high = first, len(pixel)
    while low < high:
        middle = (low + high) // 2
        if pixel[middle] <= pixel[first - 1]:
            low = middle + 1
        else:
            high = middle
    return low


@parallel
def _sketch_sorted(pixel, toa, rows, sums, photons, parts):
    for part in prange(parts):
        p, last = _border(pixel, part * len(pixel) // parts), _border(pixel, (part + 1) * len(pixel) // parts)
        while p < last:
            i, first = pixel[p], p
            p = add_run(rows, toa, pixel, p, last, sums[i])
            photons[i] += p - first


def sketch_sorted(pixel, toa, rows, sums, photons):
    """sums[pixel_p] += rows[x_p], photons[pixel_p] += 1, in place, for photons sorted by pixel.

    Args:
        pixel: uint32 [N], below the number of pixels, never decreasing.
        toa: uint16 [N], below T.
        rows: of `fixed_rows`.
    """
    _sketch_sorted(pixel, toa, rows, sums, photons, _parts(len(pixel)))


# ---- Photons in any order: a counting sort first

@parallel
def _sketch_unsorted(pixel, toa, rows, sums, photons, place):
    """`place` [strips, pixels], 0: of each strip of photons how many are of a pixel, then where the next goes."""
    number, strips = len(pixel), len(place)
    in_order = np.empty(number, np.uint16)
    for strip in prange(strips):
        own, counts = pixel[strip * number // strips:(strip + 1) * number // strips], place[strip]
        for p in range(len(own)):
            counts[own[p]] += np.uint32(1)
    total = np.uint32(0)
    for i in range(len(sums)):
        for strip in range(strips):
            total, place[strip, i] = total + place[strip, i], total
    for strip in prange(strips):
        first, last = strip * number // strips, (strip + 1) * number // strips
        own, own_toa, to = pixel[first:last], toa[first:last], place[strip]
        for p in range(len(own)):
            i = own[p]
            at = to[i]
            in_order[at] = own_toa[p]
            to[i] = at + np.uint32(1)
    ends = place[strips - 1]
    for i in prange(len(sums)):
        p = np.int64(ends[i - 1]) if i > 0 else 0
        last = np.int64(ends[i])
        photons[i] += last - p
        while p < last:
            p = add_run(rows, in_order, None, p, last, sums[i])


def sketch_unsorted(pixel, toa, rows, sums, photons):
    """As `sketch_sorted`, for photons in any order."""
    block, strips = max(BLOCK, 8 * len(sums)), min(get_num_threads(), STRIPS)
    for first in range(0, len(pixel), block):
        place = np.zeros((strips, len(sums)), np.uint32)
        _sketch_unsorted(pixel[first:first + block], toa[first:first + block], rows, sums, photons, place)


# ---- ToA with fractions: every photon gets a row of its own

@inline
def _cosine(turns):
    """cos of 2π · turns / TURN · UNIT; uint32."""
    phase = np.int32(turns)
    x = F32(np.int32(abs(phase) - np.int32(TURN // 4))) * F32(1 / TURN)           # cos p = −sin(|p| − 1/4 turn)
    y = x * x
    s = _SIN[4]
    s = s * y + _SIN[3]
    s = s * y + _SIN[2]
    s = s * y + _SIN[1]
    s = s * y + _SIN[0]
    return np.int32(np.rint(s * x))


@parallel
def _fill_rows(toa, turns_per_bin, cycles, lead, widths, rows):
    photons = len(rows) // widths.sum()
    for tile in prange((photons + TILE - 1) // TILE):
        first = TILE * tile
        count = min(TILE, photons - first)
        turns, spread = np.zeros(TILE, np.uint32), np.empty(LANES * TILE, np.uint32)
        for p in range(min(count, len(toa) - first)):
            turns[p] = np.int64(np.rint(toa[first + p] * turns_per_bin))
        before = 0
        for block in range(len(widths)):
            width, k, shift = widths[block], cycles[block], lead[block]
            out = rows[before * photons + width * first:]
            for p in range(count):
                for lane in range(width):
                    spread[width * p + lane] = turns[p]
            for i in range(0, width * count, LANES):        # rows of 4 or 8 lanes lie beside each other
                into, turn = out[i:], spread[i:]
                for lane in range(LANES):
                    into[lane] = _cosine(k[lane] * turn[lane] + shift[lane])
            before += width


def sketch_continuous(pixel, toa, frequencies, num_bins, ordered, sums, photons):
    """sums[pixel_p] += exp(2πi k_l x_p / T), photons[pixel_p] += 1, for times x, float32 bins, with fractions.

    Photons are sorted by pixel if `ordered` says so. x / T is rounded to 2⁻³³, 2⁸ times finer than float32 is near T:
    phases err by less than 2π k · 2⁻³³.
    """
    width, values = sums.shape[1], 2 * len(frequencies)
    cycles, lead = np.zeros(width, np.uint32), np.full(width, TURN // 4, np.uint32)    # lanes that are not used stay 0
    cycles[:values] = np.repeat(np.asarray(frequencies, np.uint32), 2)
    lead[0:values:2], lead[1:values:2] = 0, 3 * TURN // 4
    blocks = range(0, width, LANES)
    cycles, lead = (np.stack([np.resize(of[lane:lane + LANES], LANES) for lane in blocks]) for of in (cycles, lead))
    widths = np.array([min(LANES, width - lane) for lane in blocks])
    chunk = 2**16
    numbers, room = np.arange(chunk, dtype=np.uint16), aligned(_whole(min(len(toa), chunk)) * width)
    numbers.flags.writeable = toa.flags.writeable       # compiled as for ToA in bins
    add = sketch_sorted if ordered else sketch_unsorted
    for first in range(0, len(toa), chunk):
        part = toa[first:first + chunk]
        rows = room[:_whole(len(part)) * width]
        _fill_rows(part, TURN / num_bins, cycles, lead, widths, rows)
        add(pixel[first:first + chunk], numbers[:len(part)], rows, sums, photons)


def _whole(photons):
    return -(-photons // 4) * 4         # rows of 4 lanes fill whole vectors


# ---- Gates

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
                    word = tile[g, p]
                    toa[found] = word - first_word
                    found += np.uint32(word != no_detection)
                if found > 0:
                    add_run(rows, toa, None, 0, np.int64(found), sums[strip * WIDE + p])
                    photons[strip * WIDE + p] += found


def sketch_gates(words, rows, first_word, no_detection, sums, photons):
    """As `sketch_sorted`, for the photons x = word − `first_word` of all words that are not `no_detection`.

    `words` are uint16 [G, pixels], a laser cycle a row, without stray ones.
    """
    _sketch_gates(words, rows, np.uint16(first_word), np.uint16(no_detection), sums, photons)
