"""Photons → sketch: sums are int64 [pixels, 2m] in units of 1 / UNIT and exact.

On a GPU the bus brings at most 8·10⁹ photons of 6 bytes a second (50 GB/s). Nothing has been timed there yet.
"""

import math

import torch

from srt3d_ros.kernels.constants import MAX_PHOTONS

UNIT = 2**26            # the sums of 2³⁷ photons of a pixel fit
TOGETHER = 2**20        # photons whose rows are in memory at once
MOST_COUNTS = 2**26     # of histograms at a time: 256 MB as float32


def fixed_rows(table):
    """A table of exp(i ω_l b), float32 [T, 2m], re and im interleaved, as the backend's `sketch_*` read it."""
    return (table.double() * UNIT).round().long()


def new_sums(pixels, values):
    """Empty sums of `values` = 2m numbers for each pixel, and numbers of photons, int64 [pixels].

    The form of the sums is the backend's, but [pixels, …], and 0 for no photons. Sums of `cpu` and `cuda` are
    integers: the same photons give the same bits in any order.
    """
    return torch.zeros(pixels, values, dtype=torch.int64), torch.zeros(pixels, dtype=torch.int64)


def read_sums(sums, photons, values):
    """Σ_p exp(i ω_l x_p) · min(1, MAX_PHOTONS / n), complex64 [pixels, m], and min(n, MAX_PHOTONS), uint32.

    `values` may be less than the sums have: the first count.
    """
    share = MAX_PHOTONS / photons.clamp(min=MAX_PHOTONS).double() / UNIT
    z = torch.view_as_complex((sums[:, :values].double() * share[:, None]).float().view(-1, values // 2, 2))
    return z, photons.clamp(max=MAX_PHOTONS).to(torch.uint32)


def counted(sums, column):
    """Photons whose row has a 1 in this column, where all others have 0 there; int64 [pixels]."""
    return (sums[:, column] + UNIT // 2) // UNIT


def inspect_events(pixel, toa, pixels, num_bins):
    """Whether all photons have a pixel below `pixels` and 0 ≤ x < T, and whether `pixel` never decreases."""
    pixel, toa = pixel.long(), toa.double()
    inside = (pixel < pixels) & (toa >= 0) & (toa < num_bins)
    return bool(inside.all()), bool((pixel[1:] >= pixel[:-1]).all())


def find_stray(words, first_word, no_detection, num_bins):
    """The highest word, of uint16 [G, pixels], that is neither `no_detection` nor `first_word` + a bin; else −1."""
    words = words.int()
    stray = (words != no_detection) & ((words < first_word) | (words >= first_word + num_bins))
    return int(torch.where(stray, words, -1).max())


def _add(pixel, toa, rows_of, sums, photons):
    """Add the rows [N, 2m] of photons, in any order."""
    for own, x in zip(pixel.split(TOGETHER), toa.split(TOGETHER)):
        own = own.long()
        sums.index_add_(0, own, rows_of(x))
        photons.index_add_(0, own, torch.ones_like(own))


def sketch_sorted(pixel, toa, rows, sums, photons):
    """sums[pixel_p] += rows[x_p], photons[pixel_p] += 1, in place, for photons sorted by pixel.

    Args:
        pixel: uint32 [N], below the number of pixels, never decreasing.
        toa: unsigned integers [N], below T.
        rows: of `fixed_rows`.
    """
    _add(pixel, toa, lambda x: rows[x.long()], sums, photons)


def sketch_unsorted(pixel, toa, rows, sums, photons):
    """As `sketch_sorted`, for photons in any order."""
    sketch_sorted(pixel, toa, rows, sums, photons)


def sketch_continuous(pixel, toa, frequencies, num_bins, ordered, sums, photons):
    """sums[pixel_p] += exp(2πi k_l x_p / T), photons[pixel_p] += 1, for times x, float32 bins, with fractions.

    Photons are sorted by pixel if `ordered` says so. `frequencies` are the integers k_l.
    """
    k = torch.tensor(frequencies, dtype=torch.float64, device=toa.device)

    def rows_of(x):
        turns = x.double()[:, None] / num_bins * k
        angle = 2 * math.pi * (turns - turns.round())
        return fixed_rows(torch.stack([torch.cos(angle), torch.sin(angle)], dim=2).flatten(1))

    _add(pixel, toa, rows_of, sums, photons)


def sketch_gates(words, rows, first_word, no_detection, sums, photons):
    """As `sketch_sorted`, for the photons x = word − `first_word` of all words that are not `no_detection`.

    `words` are uint16 [G, pixels], a laser cycle a row, without stray ones.
    """
    words = words.int()
    cycle, pixel = (words != no_detection).nonzero(as_tuple=True)
    sketch_unsorted(pixel, words[cycle, pixel] - first_word, rows, sums, photons)


def sketch_histograms(counts, table, of_template, sums, photons):
    """sums_i += Σ_j counts_ij table_j − of_template, and its last column but one, if above 0, to photons_i.

    A product of matrices in float32: what it costs does not depend on the counts. `sums` may be of 2m values only,
    then what is behind them counts for `photons` alone.

    Args:
        counts: uint8, uint16, int32 or float32 [pixels, n].
        table: float32 [n, 2m + 2] of exp(i ω_l b), re and im interleaved, then 1 and 0; [pixels, n, 2m + 2] if
            pixels have bins of their own; zeros for bins that do not count.
        of_template: float32 [2m + 2] or [pixels, 2m + 2], or None.
    """
    wanted, block = min(sums.shape[1], table.shape[-1]), max(MOST_COUNTS // counts.shape[1], 1)
    for first in range(0, len(counts), block):
        part = slice(first, first + block)
        as_float = counts[part].to(table.dtype)
        product = as_float @ table if table.ndim == 2 else torch.bmm(as_float[:, None], table[part])[:, 0]
        if of_template is not None:
            product -= of_template if of_template.ndim == 1 else of_template[part]
        sums[part, :wanted] += fixed_rows(product[:, :wanted])
        photons[part] += product[:, -2].clamp(min=0).round().long()
