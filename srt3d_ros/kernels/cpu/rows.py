"""Sums of table rows in vector registers, in fixed point: what all sketching on the CPU consists of.

A row holds exp(i ω_l x) as 32-bit integers, UNIT for 1. Integers add up exactly, so a sketch does not depend, bit for
bit, on the order of the photons, on packets, threads or forms, and the rounding of a row, 2⁻²⁴, is that of float32.

Rows are kept in blocks of 16 lanes and a last one of 4, 8 or 16, each block of all rows by itself: of 2m = 20 lanes
one whole cache line and a quarter of one. Plain loops of numba take 1.2 (at 1 photon per pixel) to 3.5 times as long
(at 400): it cannot keep a vector of sums in registers over a loop, thus the LLVM code.
"""

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from srt3d_ros.kernels.cpu import arithmetic
from srt3d_ros.kernels.cpu.compiling import inline

UNIT = 2**23
MOST = 255          # rows whose sum is sure to fit into 32 bits
LANES = 16          # of a block: 64 bytes, a cache line


def lanes(values: int) -> int:
    """Lanes of rows of so many values."""
    tail = values % LANES
    return max(values - tail + (0 if tail == 0 else 4 if tail <= 4 else 8 if tail <= 8 else LANES), LANES)


def fixed_rows(table: np.ndarray) -> np.ndarray:
    """float32 [T, 2m], values up to 1 → int32 [T · lanes], as `add_run` reads them; begins with a cache line."""
    height, values = table.shape
    wide = np.zeros((height, lanes(values)), np.int32)
    wide[:, :values] = np.rint(table * np.float64(UNIT))
    blocks = [wide[:, first:first + LANES].reshape(-1) for first in range(0, wide.shape[1], LANES)]
    return np.concatenate(blocks, out=arithmetic.aligned.py_func(wide.size).view(np.int32))


def _adder(*widths):
    """Adds blocks of these widths, from `lane` on, of rows of photons: see `add_run`."""

    @intrinsic
    def add(_, rows, toa, pixel, first, last, sums, lane):
        signature = types.int64(rows, toa, pixel, first, last, sums, lane)

        def generate(context, builder, signature, values):
            def array(k):
                return context.make_array(signature.args[k])(context, builder, values[k])

            rows, toa, sums = array(0), array(1).data, array(5)
            *_, first, last, _, lane = values
            size = ir.IntType(64)
            height = builder.udiv(builder.extract_value(rows.shape, 0), builder.extract_value(sums.shape, 0))
            blocks = []
            for width in widths:
                total = cgutils.alloca_once_value(builder, ir.Constant(ir.VectorType(ir.IntType(32), width), None))
                begin = builder.gep(rows.data, [builder.mul(lane, height)])
                blocks.append((width, total, begin, builder.gep(sums.data, [lane])))
                lane = builder.add(lane, size(width))
            one_pixel = isinstance(signature.args[2], types.NoneType)
            own = None if one_pixel else builder.load(builder.gep(array(2).data, [first]))
            with cgutils.for_range(builder, last, first) as loop:
                if not one_pixel:
                    other = builder.load(builder.gep(array(2).data, [loop.index]))
                    with builder.if_then(builder.icmp_unsigned("!=", other, own)):
                        loop.do_break()
                row = builder.zext(builder.load(builder.gep(toa, [loop.index])), size)
                for width, total, begin, _ in blocks:
                    place = builder.bitcast(builder.gep(begin, [builder.mul(row, size(width))]), total.type)
                    builder.store(builder.add(builder.load(total), builder.load(place, align=4)), total)
            for width, total, _, into in blocks:
                wide = ir.VectorType(size, width)
                into = builder.bitcast(into, wide.as_pointer())
                added = builder.sext(builder.load(total), wide)
                builder.store(builder.add(builder.load(into, align=8), added), into, align=8)
            return loop.index

        return signature, generate

    return add


_add_16, _add_20, _add_24 = _adder(16), _adder(16, 4), _adder(16, 8)


@inline
def add_run(rows, toa, pixel, first, last, sums):
    """sums += Σ rows[toa[p]] of the photons of one pixel, from `first` on; returns where they, MOST or `last`, end.

    Equal numbers in `pixel` follow each other; None if all photons are of one pixel.
    """
    lane, last = 0, min(first + MOST, last)
    while len(sums) - lane > 24:
        last = _add_16(rows, toa, pixel, first, last, sums, lane)
        lane += LANES
    if len(sums) - lane == 20:
        return _add_20(rows, toa, pixel, first, last, sums, lane)
    if len(sums) - lane == 24:
        return _add_24(rows, toa, pixel, first, last, sums, lane)
    return _add_16(rows, toa, pixel, first, last, sums, lane)
