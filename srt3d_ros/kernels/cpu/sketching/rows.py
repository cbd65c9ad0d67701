"""Sums of table rows in vector registers, in fixed point: what all sketching on the CPU consists of.

A row holds exp(i ω_l x) as 32-bit integers, UNIT for 1. Integers add up exactly, so a sketch does not depend, bit for
bit, on the order of the photons, on packets, threads or forms, and the rounding of a row, 2⁻²⁴, is that of float32.

Rows are cut into parts of LANES values, one and a half cache lines. Plain loops of numba take 1.2 (at 1 photon per
pixel) to 3.5 times as long (at 400): it cannot keep a vector of sums in registers over a loop, thus the LLVM code.
"""

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from srt3d_ros.kernels.cpu import arithmetic
from srt3d_ros.kernels.cpu.compiling import inline

UNIT = 2**23
MOST = 255              # rows whose sum is sure to fit into 32 bits
VECTORS = (0, 16), (16, 8)      # of a part: first lanes and numbers of lanes that processors have registers for
LANES = 24              # of a part: m = 10 and a column that counts take one


def fixed_rows(table: np.ndarray) -> np.ndarray:
    """float32 [T, C], values up to 1 → int32 [parts, T, LANES], as `add_run` reads them; begins with a cache line."""
    height, values = table.shape
    wide = np.zeros((height, -(-values // LANES) * LANES), np.int32)
    wide[:, :values] = np.rint(table * np.float64(UNIT))
    rows = arithmetic.aligned.py_func(wide.size).view(np.int32).reshape(-1, height, LANES)
    rows[:] = wide.reshape(height, -1, LANES).swapaxes(0, 1)
    return rows


@intrinsic
def _add(_, rows, toa, pixel, first, last, sums):
    """As `add_run`, of one part, int32 [T, LANES], and up to 32 bits."""
    def generate(context, builder, signature, values):
        def begin(k):
            return context.make_array(signature.args[k])(context, builder, values[k]).data

        *_, first, last, _ = values
        size, one_pixel = ir.IntType(64), isinstance(signature.args[2], types.NoneType)
        own = None if one_pixel else builder.load(builder.gep(begin(2), [first]))
        totals = [cgutils.alloca_once_value(builder, ir.Constant(ir.VectorType(ir.IntType(32), width), None))
                  for _, width in VECTORS]
        with cgutils.for_range(builder, last, first) as loop:
            if not one_pixel:
                other = builder.load(builder.gep(begin(2), [loop.index]))
                with builder.if_then(builder.icmp_unsigned("!=", other, own)):
                    loop.do_break()
            row = builder.zext(builder.load(builder.gep(begin(1), [loop.index])), size)
            for (lane, _), total in zip(VECTORS, totals, strict=True):
                place = builder.gep(begin(0), [builder.add(builder.mul(row, size(LANES)), size(lane))])
                part = builder.load(builder.bitcast(place, total.type), align=4)
                builder.store(builder.add(builder.load(total), part), total)
        for (lane, width), total in zip(VECTORS, totals, strict=True):
            wide = ir.VectorType(size, width)
            into = builder.bitcast(builder.gep(begin(5), [size(lane)]), wide.as_pointer())
            added = builder.sext(builder.load(total), wide)
            builder.store(builder.add(builder.load(into, align=8), added), into, align=8)
        return loop.index

    return types.int64(rows, toa, pixel, first, last, sums), generate


@inline
def add_run(rows, toa, pixel, first, last, sums):
    """sums += Σ rows[toa[p]] of the photons of one pixel, from `first` on; returns where they, MOST or `last`, end.

    Equal numbers in `pixel` follow each other; None if all photons are of one pixel.
    """
    last = min(first + MOST, last)
    for part in range(len(rows)):
        last = _add(rows[part], toa, pixel, first, last, sums[part * LANES:(part + 1) * LANES])
    return last
