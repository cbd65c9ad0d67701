"""Sums of table rows in vector registers, in fixed point: what all sketching on the CPU consists of.

A row holds exp(i ω_l x) as 32-bit integers, UNIT for 1. Integers add up exactly, so a sketch does not depend, bit for
bit, on the order of the photons, on packets, threads or forms, and the rounding of a row, 2⁻²⁴, is that of float32.

Rows are kept in blocks of 16 lanes and a tail of 0, 4, 8 or 16, each block of all rows by itself: of 2m = 20 lanes one
whole cache line and a quarter of one. Numba cannot keep a vector of sums in registers over a loop, thus the LLVM code.
"""

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

UNIT = 2**23
MOST = 255          # rows whose sum is sure to fit into 32 bits
LANES = 16          # of a block: 64 bytes, a cache line


def lanes(values: int) -> int:
    """Lanes of rows of so many values: whole blocks and a tail of 4 or 8."""
    tail = values % LANES
    return max(values - tail + (0 if tail == 0 else 4 if tail <= 4 else 8 if tail <= 8 else LANES), LANES)


def fixed_rows(table: np.ndarray) -> np.ndarray:
    """float32 [T, 2m], values up to 1 → int32 [T · lanes], as `add_rows` reads them."""
    height, values = table.shape
    wide = np.zeros((height, lanes(values)), np.int32)
    wide[:, :values] = np.rint(table * np.float64(UNIT))
    parts = [wide[:, first:first + LANES].reshape(-1) for first in range(0, wide.shape[1], LANES)]
    return np.concatenate(parts, out=aligned(wide.size))


def aligned(size: int) -> np.ndarray:
    """Uninitialised int32 [size] that starts with a cache line: a row of 16 lanes then touches one, not two."""
    room = np.empty(size + LANES, np.int32)
    first = -room.ctypes.data % 64 // 4
    return room[first:first + size]


def _adder(*widths):
    """Adds blocks of these widths: void (rows, at, height, toa, first, last, sums, lane)."""

    @intrinsic
    def add(_, rows, at, height, toa, first, last, sums, lane):
        signature = types.void(rows, at, height, toa, first, last, sums, lane)

        def generate(context, builder, signature, values):
            size, byte = ir.IntType(64), ir.IntType(8)
            narrow = [ir.VectorType(ir.IntType(32), width) for width in widths]
            rows, toa, sums = (context.make_array(signature.args[k])(context, builder, values[k]).data
                               for k in (0, 3, 6))
            at, height, first, last, lane = (values[k] for k in (1, 2, 4, 5, 7))

            blocks = []                          # where each block starts
            for width in widths:
                blocks.append(builder.bitcast(builder.gep(rows, [at]), byte.as_pointer()))
                at = builder.add(at, builder.mul(height, size(width)))

            before, loop, body, after = builder.block, *(builder.append_basic_block() for _ in range(3))
            builder.branch(loop)
            builder.position_at_end(loop)
            photon = builder.phi(size)
            photon.add_incoming(first, before)
            totals = [builder.phi(kind) for kind in narrow]
            for total, kind in zip(totals, narrow, strict=True):
                total.add_incoming(ir.Constant(kind, [0] * kind.count), before)
            builder.cbranch(builder.icmp_signed("<", photon, last), body, after)

            builder.position_at_end(body)
            row = builder.zext(builder.load(builder.gep(toa, [photon])), size)
            for total, kind, block in zip(totals, narrow, blocks, strict=True):
                place = builder.gep(block, [builder.mul(row, size(4 * kind.count))])
                total.add_incoming(builder.add(total, builder.load(builder.bitcast(place, kind.as_pointer()), align=4)),
                                   body)
            photon.add_incoming(builder.add(photon, size(1)), body)
            builder.branch(loop)

            builder.position_at_end(after)
            for total in totals:
                wide = ir.VectorType(context.get_value_type(signature.args[6].dtype), total.type.count)
                place = builder.bitcast(builder.gep(sums, [lane]), wide.as_pointer())
                more = total if wide == total.type else builder.sext(total, wide)
                builder.store(builder.add(builder.load(place, align=4), more), place, align=4)
                lane = builder.add(lane, size(total.type.count))
            return context.get_dummy_value()

        return signature, generate

    return add


_add_16, _add_20, _add_24, _add_32 = _adder(16), _adder(16, 4), _adder(16, 8), _adder(16, 16)


@njit(inline="always")
def add_rows(rows, toa, first, last, sums):
    """sums += Σ rows[toa[p]] over first ≤ p < last, at most MOST of them.

    Args:
        rows: of `fixed_rows`.
        toa: unsigned integers.
        sums: int64 [lanes], values of UNIT.
    """
    width = len(sums)
    height = len(rows) // width
    lane = 0
    while width - lane > 32:
        _add_16(rows, lane * height, height, toa, first, last, sums, lane)
        lane += 16
    if width - lane == 20:
        _add_20(rows, lane * height, height, toa, first, last, sums, lane)
    elif width - lane == 32:
        _add_32(rows, lane * height, height, toa, first, last, sums, lane)
    elif width - lane == 24:
        _add_24(rows, lane * height, height, toa, first, last, sums, lane)
    else:
        _add_16(rows, lane * height, height, toa, first, last, sums, lane)
