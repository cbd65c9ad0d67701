"""Sums of cells along planes that fall, stay and rise, Σ w z exp(−i ω_l slope · d), for the windows of `search`.

A window is separable: rows are summed downwards (`pool_down`), and the sums to the right (`pool_across`). At distance d
before and after a cell, a slope turns phases by φ and −φ: one sum over w cos φ (z₊ + z₋) and one over w sin φ (z₊ − z₋)
give both the falling and the rising line.
"""

import numpy as np

from srt3d_ros.kernels.cpu.arithmetic import ONE, ZERO
from srt3d_ros.kernels.cpu.compiling import line

SLANTS = 3                  # falling, flat and rising


def turns_of(weights, turns):
    """w, w cos φ and w sin φ of a window's cells at distances 1 … reach, along which a slope turns phases by φ.

    `turns` [m] are of one cell. Returns float32 [m, reach, 3].
    """
    apart = np.arange(1, len(weights) // 2 + 1)
    phase = 2 * np.pi * np.outer(turns, apart)
    ways = np.stack([np.ones_like(phase), np.cos(phase), np.sin(phase)], axis=2)
    return np.ascontiguousarray(weights[len(weights) // 2 + apart][:, None] * ways, np.float32)


@line
def _add_pair(before, after, turn, sums):
    """Add two rows at the same distance before and after: w cos φ (z₊ + z₋), w sin φ (z₊ − z₋) and w (z₊ + z₋).

    Three loops of few arrays each: the compiler has to check that the arrays of a loop do not overlap.
    """
    (weight, cosine, sine), (even, odd, flat, both) = turn, sums
    for j in range(len(before)):
        both[j] = after[j] + before[j]
    for j in range(len(before)):
        odd[j] += sine * (after[j] - before[j])
    for j in range(len(before)):
        even[j] += cosine * both[j]
        flat[j] += weight * both[j]


@line
def _write_pools(re, im, sums, l, m, pools):
    """Write the windows along lines that fall, stay and rise: Σ w z exp(iφ), Σ w z and Σ w z exp(−iφ)."""
    (even_re, odd_re, flat_re, _), (even_im, odd_im, flat_im, _) = sums[:4], sums[4:]
    for j in range(len(re)):
        even_re[j] += re[j]
        flat_re[j] += re[j]
    for j in range(len(im)):
        even_im[j] += im[j]
        flat_im[j] += im[j]
    for way, sign in ((0, -ONE), (2, ONE)):
        real, imaginary = pools[way, l], pools[way, m + l]
        for j in range(len(re)):
            real[j] = even_re[j] + sign * odd_im[j]
        for j in range(len(im)):
            imaginary[j] = even_im[j] - sign * odd_re[j]
    pools[1, l, :len(re)], pools[1, m + l, :len(re)] = flat_re[:len(re)], flat_im[:len(re)]


@line
def pool_down(i, cells, turns, sums, lines):
    """Sum the rows of cells around row i along three slopes: lines [SLANTS, 2m, margin + cells + margin]."""
    (m, reach, _), nothing = turns.shape, np.zeros(cells.shape[2], np.float32)
    for l in range(m):
        sums[:] = ZERO
        for part in range(2):
            channel = part * m + l
            for d in range(1, reach + 1):
                before = cells[i - d, channel] if i >= d else nothing
                after = cells[i + d, channel] if i + d < len(cells) else nothing
                _add_pair(before, after, turns[l, d - 1], sums[4 * part:4 * part + 4])
        _write_pools(cells[i, l], cells[i, m + l], sums, l, m, lines[:, :, reach:])


@line
def pool_across(lines, turns, places, near, sums, pools):
    """Sum the cells of lines around those at these places along three slopes: pools [SLANTS, 2m, places]."""
    m, reach, _ = turns.shape
    before, after, middle = near[0, :len(places)], near[1, :len(places)], near[2:, :len(places)]
    for l in range(m):
        sums[:] = ZERO
        for part in range(2):
            row = lines[part * m + l]
            for d in range(1, reach + 1):
                for x in range(len(places)):
                    before[x], after[x] = row[places[x] + reach - d], row[places[x] + reach + d]
                _add_pair(before, after, turns[l, d - 1], sums[4 * part:4 * part + 4])
            for x in range(len(places)):
                middle[part, x] = row[places[x] + reach]
        _write_pools(middle[0], middle[1], sums, l, m, pools)
