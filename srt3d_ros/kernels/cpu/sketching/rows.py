"""Fixed-point sums of table rows: the inner loop of all sketching on the CPU.

`add_run` computes sums += Σ_p rows[x_p], where row x holds exp(i ω_l x) in units of 1 / UNIT. Integers add up exactly,
so a sketch has the same bits for every order of the photons, packets, threads and forms of input. Rounding a row to
2⁻²⁴ costs as much precision as float32 has.

A row is cut into parts of ROW_LANES values. `_add_in_registers` keeps the sums of a part in vector registers and is
written in LLVM's language, because numba cannot: it keeps sums in memory and checks for every row whether the two
overlap. `_add_in_loop`, the plain form, takes its place where an llvmlite release no longer compiles it; it takes 1.4
times as long at 1 photon per pixel, 2.0 at 10 and 4.6 at 400 (m = 10, T = 586). Rows four or eight at a time, two sums
to an integer and sums in a local array were tried too: none reached more than 40 % of the photons per second at 400.
"""

import logging
from functools import lru_cache

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic, overload

from srt3d_ros.kernels.cpu.compiling import inline
from srt3d_ros.kernels.cpu.device import zeros
from srt3d_ros.kernels.maps import MAX_ROWS, ROW_LANES, UNIT

REGISTERS = (0, 16), (16, 8)        # first value and number of values of each vector: widths that processors have
LOG = logging.getLogger(__name__)


def fixed_rows(table: np.ndarray) -> np.ndarray:
    """The rows that `add_run` reads, int32 [parts, T, ROW_LANES], of a table of values up to 1, float32 [T, C]."""
    height, values = table.shape
    wide = np.zeros((height, -(-values // ROW_LANES) * ROW_LANES), np.int32)
    wide[:, :values] = np.rint(table * np.float64(UNIT))
    rows = zeros(wide.shape[1] // ROW_LANES, height, ROW_LANES).view(np.int32)
    rows[:] = wide.reshape(height, -1, ROW_LANES).swapaxes(0, 1)
    return rows


@inline
def _add_in_loop(rows, toa, pixel, first, last, sums):
    """Add up one part of a run's rows, int32 [T, ROW_LANES]; returns where the run ends."""
    p = first
    while p < last and _is_pixel(pixel, p, first):
        row = rows[toa[p]]
        for lane in range(len(row)):
            sums[lane] += row[lane]
        p += 1
    return p


@inline
def _is_pixel(pixel, p, first):
    """Whether photon p is of the same pixel as the first."""
    if pixel is None:
        return True
    return pixel[p] == pixel[first]


@intrinsic
def _add_in_registers(_, rows, toa, pixel, first, last, sums):
    """As `_add_in_loop`, up to MAX_ROWS photons."""
    def generate(context, builder, signature, values):
        def begin(k):
            return context.make_array(signature.args[k])(context, builder, values[k]).data

        *_, first, last, _ = values
        size, one_pixel = ir.IntType(64), isinstance(signature.args[2], types.NoneType)
        own = None if one_pixel else builder.load(builder.gep(begin(2), [first]))
        totals = [cgutils.alloca_once_value(builder, ir.Constant(ir.VectorType(ir.IntType(32), width), None))
                  for _, width in REGISTERS]
        with cgutils.for_range(builder, last, first) as loop:
            if not one_pixel:
                other = builder.load(builder.gep(begin(2), [loop.index]))
                with builder.if_then(builder.icmp_unsigned("!=", other, own)):
                    loop.do_break()
            row = builder.zext(builder.load(builder.gep(begin(1), [loop.index])), size)
            for (lane, _), total in zip(REGISTERS, totals, strict=True):
                place = builder.gep(begin(0), [builder.add(builder.mul(row, size(ROW_LANES)), size(lane))])
                part = builder.load(builder.bitcast(place, total.type), align=4)
                builder.store(builder.add(builder.load(total), part), total)
        for (lane, width), total in zip(REGISTERS, totals, strict=True):
            wide = ir.VectorType(size, width)
            into = builder.bitcast(builder.gep(begin(5), [size(lane)]), wide.as_pointer())
            added = builder.sext(builder.load(total), wide)
            builder.store(builder.add(builder.load(into, align=8), added), into, align=8)
        return loop.index

    return types.int64(rows, toa, pixel, first, last, sums), generate


@lru_cache
def _registers_work() -> bool:
    """Whether `_add_in_registers` compiles and adds as `_add_in_loop` does."""
    rows = np.arange(-30, 66, dtype=np.int32).reshape(4, ROW_LANES)
    toa, pixel = np.array([1, 3, 3, 0, 2], np.uint16), np.array([7, 7, 7, 7, 8], np.uint32)
    found = np.ones((2, ROW_LANES), np.int64)
    try:
        add = njit(lambda rows, toa, pixel, first, last, sums: _add_in_registers(rows, toa, pixel, first, last, sums))
        ends = [add(rows, toa, pixel, 1, 5, found[0]), add(rows, toa, None, 0, 5, found[1])]
    except Exception as error:      # of numba or llvmlite, whatever their next release raises
        LOG.warning(f"sketching takes up to five times as long with this llvmlite: {error}")
        return False
    return ends == [4, 5] and np.array_equal(found - 1, [rows[toa[1:4]].sum(axis=0), rows[toa].sum(axis=0)])


def add_run(rows, toa, pixel, first, last, sums):
    """Add up rows[toa[p]] of one pixel's photons from `first` on, in place; returns where the run ends.

    A run ends where `pixel` changes, after MAX_ROWS photons, or at `last`. `pixel` is None if all photons are of one.
    """


@overload(add_run, jit_options={"forceinline": True, "error_model": "numpy"})
def _add_run(rows, toa, pixel, first, last, sums):
    """Chosen when a kernel is compiled, so that reading kernels from the disk compiles nothing."""
    add = _add_in_registers if _registers_work() else _add_in_loop

    def run(rows, toa, pixel, first, last, sums):
        last = min(first + MAX_ROWS, last)
        for part in range(len(rows)):
            last = add(rows[part], toa, pixel, first, last, sums[part * ROW_LANES:(part + 1) * ROW_LANES])
        return last
    return run
