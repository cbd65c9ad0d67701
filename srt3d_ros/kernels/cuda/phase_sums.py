"""Photons → sketch on CUDA: a part of `kernels.api`, on tensors of the device.

Sums are int64 in units of 1 / UNIT and exact: atomic additions give the same sketch in any order. Nothing here has been
timed on a GPU yet. What is to be expected of an H200 (132 SMs at 1.8 GHz, 4.8 TB/s, 256 kB of first-level cache each):

* Sorted photons: `inspect_events` reads 6 bytes a photon, the sums read 2 (uint16 ToA) and a table row. Rows are of 16
  bits: 64 bytes for m = 10. The first-level cache gives one row a cycle and SM: 240·10⁹ photons/s where the table fits
  into it (T up to 3,500), and more than 100·10⁹ above, as most photons return from few bins. Memory alone would allow
  600·10⁹ with all 8 bytes. The rounding of rows errs by less than 2⁻¹⁵ a photon.
* Unsorted photons are counted, placed and summed: 14 bytes read, 2 written and two atomic additions more a photon, of
  which the second-level cache does about 150·10⁹ a second: 40·10⁹ photons/s.
* ToA with fractions: 20 instructions a photon and frequency, of which there are 16 for m = 10: 90·10⁹ photons/s.
* Gates are unsorted photons whose pixel need not be read; a word without a photon costs its 2 bytes twice.
"""

import torch
import triton
import triton.language as tl

from srt3d_ros.kernels.constants import MAX_PHOTONS
from srt3d_ros.kernels.cuda.arithmetic import axis, sincos
from srt3d_ros.kernels.cuda.device import DEVICE

FULL = 32_767                   # of a table row: 1.0
UNIT = 256 * FULL               # of the sums
WAVE = tl.constexpr(UNIT // 8)  # of cosines as 32-bit integers
BLOCK = 2048                    # photons or words of one program
PHOTONS = 32                    # of a pixel that are looked up together
SEGMENT = 1024                  # times so many: 2¹⁵ photons, whose rows' 32-bit sums cannot overflow
PROGRAMS = 8192                 # that a GPU should at least have
MOST_COUNTS = 2**26             # of histograms at a time: 256 MB as float32


# ---- Tables and sums

def fixed_rows(table):
    """float32 [T, 2m] → int16 [T + 1, lanes], values of 1 / FULL; the last row is that of no photon, 0."""
    bins, values = table.shape
    rows = torch.zeros(bins + 1, max(triton.next_power_of_2(values), 8), dtype=torch.int16, device=table.device)
    rows[:bins, :values] = torch.round(table * FULL)
    return rows


def new_sums(pixels, values):
    """Sums are int64 [pixels, 2m] in units of 1 / UNIT."""
    sums = torch.zeros(pixels, values, dtype=torch.int64, device=DEVICE)
    return sums, torch.zeros(pixels, dtype=torch.int64, device=DEVICE)


def read_sums(sums, photons, values):
    share = MAX_PHOTONS / photons.clamp(min=MAX_PHOTONS).to(torch.float64)
    scaled = sums[:, :values].to(torch.float32) / UNIT * share.to(torch.float32)[:, None]
    return torch.view_as_complex(scaled.view(-1, values // 2, 2)), photons.clamp(max=MAX_PHOTONS).to(torch.uint32)


def counted(sums, column):
    return (sums[:, column] + UNIT // 2) // UNIT


# ---- Checks

@triton.jit
def _inspect_events(pixel, toa, count, pixels, num_bins, found, BLOCK: tl.constexpr):
    at = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    here = at < count
    own = tl.load(pixel + at, mask=here, other=0).to(tl.int64)
    before = tl.load(pixel + at - 1, mask=here & (at > 0), other=0).to(tl.int64)
    x = tl.load(toa + at, mask=here, other=0).to(tl.float32)          # bins are below 2¹⁶; more stays more
    inside = (own < pixels) & (x >= 0) & (x < num_bins)                 # NaN is neither
    outside = tl.max((here & (inside == 0)).to(tl.int32), axis=0)
    drops = tl.max((here & (own < before)).to(tl.int32), axis=0)
    if outside > 0:
        tl.atomic_max(found, 1, sem="relaxed")
    if drops > 0:
        tl.atomic_max(found + 1, 1, sem="relaxed")


def inspect_events(pixel, toa, pixels, num_bins):
    """Waits for the answer."""
    found = torch.zeros(2, dtype=torch.int32, device=pixel.device)
    _inspect_events[(triton.cdiv(len(pixel), BLOCK),)](pixel, toa, len(pixel), pixels, num_bins, found, BLOCK=BLOCK)
    outside, drops = found.tolist()
    return not outside, not drops


@triton.jit
def _find_stray(words, count, first_word, no_detection, num_bins, stray, BLOCK: tl.constexpr):
    at = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    word = tl.load(words + at, mask=at < count, other=no_detection).to(tl.int32)
    bad = (word != no_detection) & ((word < first_word) | (word >= first_word + num_bins))
    highest = tl.max(tl.where(bad, word, -1), axis=0)
    if highest >= 0:
        tl.atomic_max(stray, highest, sem="relaxed")


def find_stray(words, first_word, no_detection, num_bins):
    """Waits for the answer."""
    count = words.numel()
    stray = torch.full((1,), -1, dtype=torch.int32, device=words.device)
    _find_stray[(triton.cdiv(count, BLOCK),)](words, count, first_word, no_detection, num_bins, stray, BLOCK=BLOCK)
    return stray.item()


# ---- Sums of photons that lie pixel by pixel

@triton.jit
def _share(starts, parts):
    """The photons of this program: a part of a pixel's."""
    start, end = tl.load(starts + tl.program_id(0)), tl.load(starts + tl.program_id(0) + 1)
    first = start + (end - start) * tl.program_id(1) // parts
    return first, start + (end - start) * (tl.program_id(1) + 1) // parts


@triton.jit
def _sum_rows(toa, starts, rows, bins, values, parts, sums, photons,
              LANES: tl.constexpr, PHOTONS: tl.constexpr, SEGMENT: tl.constexpr):
    i, lane = tl.program_id(0).to(tl.int64), tl.arange(0, LANES)
    first, last = _share(starts, parts)
    total = tl.zeros([LANES], tl.int64)
    for segment in range(first, last, PHOTONS * SEGMENT):
        short = tl.zeros([PHOTONS, LANES], tl.int32)
        at = segment + tl.arange(0, PHOTONS)
        row = tl.load(toa + at, mask=at < last, other=bins).to(tl.int32)
        for _ in range(segment, tl.minimum(segment + PHOTONS * SEGMENT, last), PHOTONS):
            at += PHOTONS
            later = tl.load(toa + at, mask=at < last, other=bins).to(tl.int32)      # on its way while these are summed
            short += tl.load(rows + row[:, None] * LANES + lane[None, :])
            row = later
        total += tl.sum(short, axis=0)
    if last > first:
        tl.atomic_add(sums + i * values + lane, total * 256, mask=lane < values, sem="relaxed")
        tl.atomic_add(photons + i, last - first, sem="relaxed")


@triton.jit
def _sum_waves(toa, starts, frequencies, per_turn, turns_per_bin, m, parts, sums, photons,
               M: tl.constexpr, PHOTONS: tl.constexpr, SEGMENT: tl.constexpr):
    i, l = tl.program_id(0).to(tl.int64), tl.arange(0, M)
    first, last = _share(starts, parts)
    k = tl.load(frequencies + l, mask=l < m, other=0)
    cosines, sines = tl.zeros([M], tl.int64), tl.zeros([M], tl.int64)
    for segment in range(first, last, PHOTONS * SEGMENT):
        c_short, s_short = tl.zeros([PHOTONS, M], tl.int32), tl.zeros([PHOTONS, M], tl.int32)
        for p in range(segment, tl.minimum(segment + PHOTONS * SEGMENT, last), PHOTONS):
            at = p + tl.arange(0, PHOTONS)
            x = tl.load(toa + at, mask=at < last, other=0.0)
            whole = tl.floor(x)
            # In 2⁻³² turns; the bin by integers, since float32 has but 24 bits. Multiples overflow by whole turns.
            turns = (whole.to(tl.int64) * per_turn >> 30) + ((x - whole) * turns_per_bin).to(tl.int64)
            phase = turns.to(tl.int32)[:, None] * k[None, :]
            s, c = sincos(phase.to(tl.float32) * (1 / 4294967296))
            here = (at < last)[:, None]
            c_short += tl.where(here, tl.floor(c * WAVE + 0.5), 0.0).to(tl.int32)
            s_short += tl.where(here, tl.floor(s * WAVE + 0.5), 0.0).to(tl.int32)
        cosines += tl.sum(c_short.to(tl.int64), axis=0)
        sines += tl.sum(s_short.to(tl.int64), axis=0)
    if last > first:
        into = sums + i * 2 * m + 2 * l
        tl.atomic_add(into, cosines * 8, mask=l < m, sem="relaxed")
        tl.atomic_add(into + 1, sines * 8, mask=l < m, sem="relaxed")
        tl.atomic_add(photons + i, last - first, sem="relaxed")


def _add_rows(toa, starts, rows, sums, photons):
    """One program a pixel, or several where pixels are few and bright: it stops at its last photon."""
    pixels, values = sums.shape
    parts = _parts(len(toa), pixels)
    _sum_rows[(pixels, parts)](toa, starts, rows, len(rows) - 1, values, parts, sums, photons, LANES=rows.shape[1],
                               PHOTONS=PHOTONS, SEGMENT=SEGMENT, num_warps=1)


def _add_waves(toa, starts, frequencies, num_bins, sums, photons):
    m, parts = len(frequencies), _parts(len(toa), len(sums))
    k = torch.tensor(frequencies, dtype=torch.int32, device=toa.device)
    _sum_waves[(len(sums), parts)](toa, starts, k, round(2**62 / num_bins), 2**32 / num_bins, m, parts, sums, photons,
                                   M=axis(m), PHOTONS=PHOTONS, SEGMENT=SEGMENT, num_warps=1)


def _parts(count, pixels):
    return max(1, min(triton.cdiv(PROGRAMS, pixels), count // (pixels * 4 * PHOTONS)))


def _bisect(pixel, pixels):
    """Where each pixel's photons start, int64 [pixels + 1], of sorted ones."""
    each = torch.arange(pixels + 1, dtype=torch.int32, device=pixel.device)
    return torch.searchsorted(pixel.view(torch.int32), each)


def sketch_sorted(pixel, toa, rows, sums, photons):
    _add_rows(toa, _bisect(pixel, len(sums)), rows, sums, photons)


# ---- Photons in any order: counted, then placed pixel by pixel. Their order within a pixel is left to chance.

@triton.jit
def _read(pixel, toa, at, count, pixels, first_word, no_detection, GATES: tl.constexpr):
    """Pixel and ToA of photons or gates, and whether there is one."""
    x = tl.load(toa + at, mask=at < count, other=0)
    if GATES:
        return at % pixels, x.to(tl.int32) - first_word, (at < count) & (x.to(tl.int32) != no_detection)
    else:
        return tl.load(pixel + at, mask=at < count, other=0).to(tl.int64), x, at < count


@triton.jit
def _count(pixel, toa, count, pixels, first_word, no_detection, numbers, GATES: tl.constexpr, BLOCK: tl.constexpr):
    at = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    i, _, some = _read(pixel, toa, at, count, pixels, first_word, no_detection, GATES)
    tl.atomic_add(numbers + i, 1, mask=some, sem="relaxed")


@triton.jit
def _place(pixel, toa, count, pixels, first_word, no_detection, places, placed, GATES: tl.constexpr,
           BLOCK: tl.constexpr):
    at = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    i, x, some = _read(pixel, toa, at, count, pixels, first_word, no_detection, GATES)
    place = tl.atomic_add(places + i, 1, mask=some, sem="relaxed")
    tl.store(placed + place, x.to(placed.dtype.element_ty), mask=some)


def _gather(pixel, toa, pixels, first_word=0, no_detection=0, gates=False):
    """ToA pixel by pixel, and where each pixel's start; of gates, room for a photon in every word."""
    starts = torch.zeros(pixels + 1, dtype=torch.int64, device=toa.device)
    numbers, placed = starts.new_zeros(pixels), torch.empty_like(toa).reshape(-1)
    grid, count = (triton.cdiv(toa.numel(), BLOCK),), toa.numel()
    _count[grid](pixel, toa, count, pixels, first_word, no_detection, numbers, GATES=gates, BLOCK=BLOCK)
    torch.cumsum(numbers, 0, out=starts[1:])
    places = starts[:-1].clone()
    _place[grid](pixel, toa, count, pixels, first_word, no_detection, places, placed, GATES=gates, BLOCK=BLOCK)
    return placed, starts


def sketch_unsorted(pixel, toa, rows, sums, photons):
    placed, starts = _gather(pixel, toa, len(sums))
    _add_rows(placed, starts, rows, sums, photons)


def sketch_continuous(pixel, toa, frequencies, num_bins, ordered, sums, photons):
    placed, starts = (toa, _bisect(pixel, len(sums))) if ordered else _gather(pixel, toa, len(sums))
    _add_waves(placed, starts, frequencies, num_bins, sums, photons)


def sketch_gates(words, rows, first_word, no_detection, sums, photons):
    placed, starts = _gather(words, words, words.shape[1], first_word, no_detection, gates=True)
    _add_rows(placed, starts, rows, sums, photons)


# ---- Histograms: a product of matrices, by cuBLAS

def sketch_histograms(counts, table, of_template, sums, photons):
    pixels, n = counts.shape
    wanted = min(sums.shape[1], table.shape[-1])
    block = max(MOST_COUNTS // n, 1)
    for first in range(0, pixels, block):
        part = slice(first, first + block)
        as_float = counts[part].to(torch.float32)
        product = as_float @ table if table.ndim == 2 else torch.bmm(as_float[:, None], table[part])[:, 0]
        if of_template is not None:
            product -= of_template if of_template.ndim == 1 else of_template[part]
        sums[part, :wanted] += torch.round(product[:, :wanted].double() * UNIT).long()
        photons[part] += torch.round(product[:, -2].clamp(min=0)).long()
