"""Fixed-point sums of table rows: the inner loop of all sketching on the CPU.

`add_run` computes sums += Σ_p rows[x_p], where row x holds exp(i ω_l x) in units of 1 / UNIT. Integers add up exactly,
so a sketch has the same bits for every order of the photons, packets, threads and forms of input. Rounding a row to
2⁻²⁴ costs as much precision as float32 has.

A row is cut into parts of ROW_LANES values, whose sums stay in registers: a vector of LANES and one of half as many.
"""

import numpy as np

from srt3d_ros.kernels.cpu.compiling import inline
from srt3d_ros.kernels.cpu.device import zeros
from srt3d_ros.kernels.cpu.vectors import load, loading, store, to_longs
from srt3d_ros.kernels.maps import LANES, MAX_ROWS, ROW_LANES, UNIT

load_rest = loading(ROW_LANES - LANES)


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
    begin, rest = load(rows, part, toa[first], 0), load_rest(rows, part, toa[first], LANES)
    p, end = np.uint64(first + 1), np.uint64(last)      # unsigned: none counts from the end, which numba would look at
    while p < end:
        if pixel is not None and pixel[p] != to:
            end = p
        else:
            begin += load(rows, part, toa[p], 0)
            rest += load_rest(rows, part, toa[p], LANES)
            p += np.uint64(1)
    at = part * ROW_LANES
    store(sums, to, at, load(sums, to, at) + to_longs(begin))
    store(sums, to, at + LANES, load_rest(sums, to, at + LANES) + to_longs(rest))
    return np.int64(end)
