"""Sums of table rows in vector registers, in fixed point: what all sketching on the CPU consists of.

A row holds exp(i ω_l x) as 32-bit integers, UNIT for 1. Integers add up exactly, so a sketch does not depend, bit for
bit, on the order of the photons, on packets, threads or forms, and the rounding of a row, 2⁻²⁴, is that of float32.

Rows are kept in blocks of 16 lanes and a tail of 0, 4, 8 or 16, each block of all rows by itself: of 2m = 20 lanes one
whole cache line and a quarter of one. Numba cannot keep a vector of sums in registers over a loop, thus the LLVM code.
"""

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from srt3d_ros.kernels.cpu import arithmetic
from srt3d_ros.kernels.cpu.compiling import inline

UNIT = 2**23
MOST = 255          # rows whose sum is sure to fit into 32 bits
LANES = 16          # of a block: 64 bytes, a cache line


def lanes(values: int) -> int:
    """Lanes of rows of so many values: whole blocks and a tail of 4 or 8."""
    tail = values % LANES
    return max(values - tail + (0 if tail == 0 else 4 if tail <= 4 else 8 if tail <= 8 else LANES), LANES)


def fixed_rows(table: np.ndarray) -> np.ndarray:
    """float32 [T, 2m], values up to 1 → int32 [T · lanes], as `add_run` reads them."""
    height, values = table.shape
    wide = np.zeros((height, lanes(values)), np.int32)
    wide[:, :values] = np.rint(table * np.float64(UNIT))
    parts = [wide[:, first:first + LANES].reshape(-1) for first in range(0, wide.shape[1], LANES)]
    return np.concatenate(parts, out=aligned(wide.size))


def aligned(size: int) -> np.ndarray:
    """Uninitialised int32 [size] that starts with a cache line: a row of 16 lanes then touches one, not two."""
    return arithmetic.aligned.py_func(size).view(np.int32)


def _adder(*widths):
    """Adds blocks of these widths, from the photon `first` on until `last` or the photon of another pixel.

    Returns where it ended. The blocks start at `at` in rows, their sums at `lane`.
    """

    @intrinsic
    def add(_, rows, at, toa, pixel, first, last, sums, lane):
        signature = types.int64(rows, at, toa, pixel, first, last, sums, lane)
        sum_type = ir.IntType(sums.dtype.bitwidth)

        def generate(context, builder, signature, values):
            size, byte = ir.IntType(64), ir.IntType(8)
            kinds = [ir.VectorType(ir.IntType(32), width) for width in widths]

            def data(k):
                return context.make_array(signature.args[k])(context, builder, values[k])

            rows, toa, sums = (data(k).data for k in (0, 2, 6))
            _, at, _, _, first, last, _, lane = values
            lanes_of_all = builder.extract_value(data(6).shape, 0)
            height = builder.udiv(builder.extract_value(data(0).shape, 0), lanes_of_all)
            blocks = []
            for width in widths:
                blocks.append(builder.bitcast(builder.gep(rows, [at]), byte.as_pointer()))
                at = builder.add(at, builder.mul(height, size(width)))
            one_pixel = isinstance(signature.args[3], types.NoneType)
            if not one_pixel:
                pixel = data(3).data
                own = builder.load(builder.gep(pixel, [first]))

            before, body, more, after = builder.block, *(builder.append_basic_block() for _ in range(3))
            builder.branch(body)
            builder.position_at_end(body)
            photon, totals = builder.phi(size), [builder.phi(kind) for kind in kinds]
            row = builder.zext(builder.load(builder.gep(toa, [photon])), size)
            places = [builder.gep(block, [builder.mul(row, size(4 * kind.count))])
                      for block, kind in zip(blocks, kinds, strict=True)]
            added = [builder.add(total, builder.load(builder.bitcast(place, kind.as_pointer()), align=4))
                     for total, place, kind in zip(totals, places, kinds, strict=True)]
            following = builder.add(photon, size(1))
            builder.cbranch(builder.icmp_signed("<", following, last), more, after)
            builder.position_at_end(more)
            if one_pixel:
                builder.branch(body)
            else:
                same = builder.icmp_unsigned("==", builder.load(builder.gep(pixel, [following])), own)
                builder.cbranch(same, body, after)
            for phi, start, next_one in zip([photon, *totals], [first, *(ir.Constant(k, [0] * k.count) for k in kinds)],
                                            [following, *added], strict=True):
                phi.add_incoming(start, before)
                phi.add_incoming(next_one, more)

            builder.position_at_end(after)
            for total, kind in zip(added, kinds, strict=True):
                wide = ir.VectorType(sum_type, kind.count)
                place = builder.bitcast(builder.gep(sums, [lane]), wide.as_pointer())
                builder.store(builder.add(builder.load(place, align=4), builder.sext(total, wide)), place, align=4)
                lane = builder.add(lane, size(kind.count))
            return following

        return signature, generate

    return add


_add_16, _add_20, _add_24, _add_32 = _adder(16), _adder(16, 4), _adder(16, 8), _adder(16, 16)


@inline
def add_run(rows, toa, pixel, first, last, sums):
    """sums += Σ rows[toa[p]] of the photons of one pixel, from `first` on; returns where they, MOST or `last`, end.

    At least one photon is added. Equal numbers in `pixel` follow each other; None if all photons are of one pixel.
    """
    width = len(sums)
    height = len(rows) // width
    last = min(first + MOST, last)
    lane = 0
    while width - lane > 32:
        last = _add_16(rows, lane * height, toa, pixel, first, last, sums, lane)
        lane += 16
    if width - lane == 20:
        return _add_20(rows, lane * height, toa, pixel, first, last, sums, lane)
    if width - lane == 32:
        return _add_32(rows, lane * height, toa, pixel, first, last, sums, lane)
    if width - lane == 24:
        return _add_24(rows, lane * height, toa, pixel, first, last, sums, lane)
    return _add_16(rows, lane * height, toa, pixel, first, last, sums, lane)
