"""The matched filter on a sketch, and where it peaks."""

import triton
import triton.language as tl

from srt3d_ros.kernels.cuda.arithmetic import TINY, axis, sincos, wrap

PIXELS = 32         # of one program
CELLS = 64          # of the response that it looks at together


@triton.jit
def peak(re, im, k, num_bins, CELLS: tl.constexpr):
    """Where the responses of some pixels to the matched filter are highest, in bins, and how high they are.

    The response Σ_l Re((re + i im)_l exp(−2πi k_l t / T)) over a grid of t is a product of matrices. Tensor cores do it
    in three products of 11-bit numbers, whose sum has the accuracy of float32, at a fraction of the time of the
    multiply-adds even if these made use of the symmetries of sine and cosine; and they leave those units free for the
    grid's sines, which each program makes for itself: so no table of them needs a home or the number of the cells, and
    nothing but the photons is read. The highest cell is computed again in float32, and its neighbours from it.

    Args:
        re, im: float32 [M, PIXELS].
        k: float32 [M], frequencies; 0 where re and im are 0.
    """
    cells = ((tl.max(k).to(tl.int32) + 3) // 4 * 16).to(tl.float32)
    highest = tl.full([CELLS, re.shape[1]], float("-inf"), tl.float32)      # of every CELLS-th cell
    where = tl.zeros([CELLS, re.shape[1]], tl.float32)
    for first in range(0, cells.to(tl.int32), CELLS):
        cell = (first + tl.arange(0, CELLS)).to(tl.float32)[:, None]
        sine, cosine = sincos(wrap(cell * k[None, :], cells) / cells)
        response = tl.dot(cosine, re, input_precision="tf32x3")
        response = tl.dot(sine, im, response, input_precision="tf32x3")
        higher = (response > highest) & (cell < cells)
        highest, where = tl.where(higher, response, highest), tl.where(higher, cell, where)
    top = tl.min(tl.where(highest == tl.max(highest, axis=0)[None, :], where, cells), axis=0)

    sine, cosine = sincos(wrap(k[:, None] * top[None, :], cells) / cells)
    along, across = re * cosine + im * sine, im * cosine - re * sine
    sine, cosine = sincos(k / cells)
    value = tl.sum(along, axis=0)
    slope = tl.sum(across * sine[:, None], axis=0)              # half of what the cell after exceeds that before by
    bend = tl.sum(along * (1.0 - cosine[:, None]), axis=0)      # what the peak exceeds the mean of both by
    shift = tl.where(bend > 0.0, 0.5 * slope / tl.maximum(bend, TINY), 0.0)
    return (top + shift) * (num_bins / cells), value + 0.5 * slope * shift


@triton.jit
def _match(matched, energy, bin_frequencies, num_bins, m, cols, count, depth, intensity, SURFACES: tl.constexpr,
           M: tl.constexpr, PIXELS: tl.constexpr, CELLS: tl.constexpr):
    pixel, l = tl.program_id(0) * PIXELS + tl.arange(0, PIXELS), tl.arange(0, M)
    at = pixel // cols * (2 * m * cols) + pixel % cols
    known = (l < m)[:, None] & (pixel < count)[None, :]
    re = tl.load(matched + at[None, :] + l[:, None] * cols, mask=known, other=0.0)
    im = tl.load(matched + at[None, :] + (m + l)[:, None] * cols, mask=known, other=0.0)
    share = tl.load(energy + l, mask=l < m, other=0.0)
    frequency = tl.load(bin_frequencies + l, mask=l < m, other=0.0)
    total = tl.sum(share)
    into = pixel // cols * (SURFACES * cols) + pixel % cols
    for k in tl.static_range(SURFACES):
        t, value = peak(re, im, tl.floor(frequency * num_bins + 0.5), num_bins, CELLS)
        tl.store(depth + into + k * cols, t, mask=pixel < count)
        tl.store(intensity + into + k * cols, value / total, mask=pixel < count)
        if k + 1 < SURFACES:
            sine, cosine = sincos(frequency[:, None] * t[None, :])
            explained = share[:, None] * (value / total)[None, :]
            re -= explained * cosine
            im -= explained * sine


def match(matched, energy, bin_frequencies, num_bins, surfaces):
    rows, channels, cols = matched.shape
    out = tuple(matched.new_empty(rows, surfaces, cols) for _ in range(2))
    m, count = channels // 2, rows * cols
    _match[(triton.cdiv(count, PIXELS),)](
        matched, energy, bin_frequencies, num_bins, m, cols, count, *out, SURFACES=surfaces, M=max(axis(m), 16),
        PIXELS=PIXELS, CELLS=CELLS, num_warps=4)
    return out
