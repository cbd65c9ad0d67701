"""Vectors for compiled code: LANES numbers in registers, with the operators of numbers.

    depth = load(state, row, k, DEPTH, col)             # of the pixels in the columns col … col + LANES − 1
    e = load(state, row, k, DEPTH, col + 1) - depth
    store(out, row, k, DEPTH, col, where(e > 0, depth + e / 2, 0))

Kinds are `floats` (float32), `ints` (int32) and `mask`. A number beside a vector counts in each lane, as its type.
LLVM splits a vector into what the processor has (SSE2, AVX2, AVX-512, NEON); 8 lanes were slower on all of them.
Nothing is contracted but `fma`, which rounds once where the processor can: a kernel gives the same bits whether it was
compiled or read from the disk, on one thread or many. NumPy has the same results for all but `fma`, `max` and `min`.
"""

import operator
from itertools import product

from llvmlite import ir
from numba import boolean, float32, int32, types
from numba.core import cgutils
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, models, register_model

from srt3d_ros.kernels.maps import LANES

I32 = ir.IntType(32)
ZEROS = ir.Constant(ir.VectorType(I32, LANES), [0] * LANES)


class Vector(types.Type):
    """LANES values of the type `lane`."""

    def __init__(self, lane):
        self.lane = lane
        super().__init__(f"{lane}x{LANES}")


floats, ints, mask = Vector(float32), Vector(int32), Vector(boolean)
NUMBERS = (floats, types.Number), (ints, types.Integer), (mask, types.Boolean)      # what may stand beside a vector


@register_model(Vector)
class _Registers(models.PrimitiveModel):
    def __init__(self, manager, kind):
        bits = {float32: ir.FloatType(), int32: I32, boolean: ir.IntType(1)}[kind.lane]
        super().__init__(manager, kind, ir.VectorType(bits, LANES))


# ---- Operators

def _kind(sides):
    """The vector that the sides of an operator are, or stand beside; None if they do not fit."""
    for kind, beside in NUMBERS:
        if kind in sides and all(side == kind or isinstance(side, beside) for side in sides):
            return kind


def _spread(context, builder, value, side, kind):
    """A vector; a number in each of its lanes."""
    if side == kind:
        return value
    nothing = ir.Constant(context.get_value_type(kind), ir.Undefined)
    first = builder.insert_element(nothing, context.cast(builder, value, side, kind.lane), ir.Constant(I32, 0))
    return builder.shuffle_vector(first, nothing, ZEROS)


def _operator(keys, emit, result=None, sides=(2,)):
    """Define an operator by what it emits for each kind: emit = {kind: function of builder and values}.

    Its result has the same kind, or `result`. `keys` are names of the operator; numba lowers by the first.
    """
    def generic(self, args, kws):
        kind = _kind(args)
        return signature(result or kind, *map(types.unliteral, args)) if kind in emit else None

    def lower(context, builder, sig, args):
        kind = _kind(sig.args)
        first, *more = (_spread(context, builder, value, side, kind) for value, side in zip(args, sig.args))
        if not more:
            return emit[kind](builder, first)
        for value in more:
            first = emit[kind](builder, first, value)
        return first

    for key in keys:
        infer_global(key)(type(f"Vector_{key.__name__}", (AbstractTemplate,), {"key": key, "generic": generic}))
    for number in sides:
        for chosen in product((Vector, types.Number, types.Boolean), repeat=number):
            if Vector in chosen:
                lower_builtin(keys[0], *chosen)(lower)


def _compare(sign):
    def compare(builder, x, y):
        return (builder.fcmp_unordered if sign == "!=" else builder.fcmp_ordered)(sign, x, y)
    return {floats: compare, ints: lambda builder, x, y: builder.icmp_signed(sign, x, y)}


def _larger(sign):
    """`max` or `min`: x if x is larger (smaller) than y, else y, as processors do: of a NaN beside a number, y."""
    compare = _compare(sign)
    return {kind: lambda builder, x, y, kind=kind: builder.select(compare[kind](builder, x, y), x, y)
            for kind in compare}


_make = ir.IRBuilder
_operator((operator.add, operator.iadd), {floats: _make.fadd, ints: _make.add})
_operator((operator.sub, operator.isub), {floats: _make.fsub, ints: _make.sub})
_operator((operator.mul, operator.imul), {floats: _make.fmul, ints: _make.mul})
_operator((operator.truediv, operator.itruediv), {floats: _make.fdiv})
_operator((operator.lshift,), {ints: _make.shl})
_operator((operator.rshift,), {ints: _make.ashr})
_operator((operator.and_, operator.iand), {mask: _make.and_, ints: _make.and_})
_operator((operator.or_, operator.ior), {mask: _make.or_, ints: _make.or_})
_operator((operator.invert,), {mask: _make.not_}, sides=(1,))
_operator((operator.neg,), {floats: _make.fneg, ints: _make.neg}, sides=(1,))
for _key, _sign in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="),
                    (operator.eq, "=="), (operator.ne, "!=")):
    _operator((_key,), _compare(_sign), mask)
_operator((max,), _larger(">"), sides=(2, 3, 4))
_operator((min,), _larger("<"), sides=(2, 3, 4))


# ---- Functions

def _call(builder, name, *values):
    """A call of LLVM's own function for float32 or `floats`."""
    of = values[0].type
    suffix = f"v{LANES}f32" if isinstance(of, ir.VectorType) else "f32"
    return builder.call(cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(of, [of] * len(values)), f"llvm.{name}.{suffix}"), values)


def _of_one(name):
    """A function of `floats`, or of one float32."""
    @intrinsic
    def apply(context, x):
        kind = floats if x == floats else float32
        return kind(kind), lambda context, builder, sig, args: _call(builder, name, *args)
    return apply


rint, floor, sqrt = map(_of_one, ("rint", "floor", "sqrt"))
_operator((abs,), {floats: lambda builder, x: _call(builder, "fabs", x)}, sides=(1,))


@intrinsic
def fma(context, a, b, c):
    """a · b + c, of vectors or of numbers, rounded once where the processor has an instruction for it."""
    kind = floats if floats in (a, b, c) else float32

    def generate(context, builder, sig, args):
        return _call(builder, "fmuladd", *(
            _spread(context, builder, value, side, kind) if kind == floats else context.cast(builder, value, side, kind)
            for value, side in zip(args, sig.args)))
    return kind(a, b, c), generate


@intrinsic
def where(context, condition, a, b):
    """a in the lanes in which the condition holds, else b."""
    kind = _kind((a, b)) or floats

    def generate(context, builder, sig, args):
        return builder.select(args[0], *(_spread(context, builder, value, side, kind)
                                         for value, side in zip(args[1:], sig.args[1:])))
    return (kind(condition, a, b), generate) if condition == mask else None


@intrinsic
def full(context, number):
    """A number in each lane."""
    kind = floats if isinstance(number, types.Float) else ints if isinstance(number, types.Integer) else mask
    return kind(number), lambda context, builder, sig, args: _spread(context, builder, args[0], number, kind)


# ---- Lanes

@intrinsic
def lane(context, vector, index):
    """The value of one lane."""
    return (vector.lane(vector, index), lambda context, builder, sig, args: builder.extract_element(
        args[0], context.cast(builder, args[1], sig.args[1], int32))) if isinstance(vector, Vector) else None


@intrinsic
def with_lane(context, vector, index, value):
    """The vector with another value in one lane."""
    return (vector(vector, index, value), lambda context, builder, sig, args: builder.insert_element(
        args[0], context.cast(builder, args[2], sig.args[2], vector.lane),
        context.cast(builder, args[1], sig.args[1], int32))) if isinstance(vector, Vector) else None


@intrinsic
def lane_numbers(context):
    """The `ints` 0, 1, 2 …"""
    return ints(), lambda context, builder, sig, args: ir.Constant(ZEROS.type, list(range(LANES)))


@intrinsic
def lanes_of(context, condition):
    """The lanes in which a condition holds, as the bits of a number; 0: in none."""
    def generate(context, builder, sig, args):
        return builder.zext(builder.bitcast(args[0], ir.IntType(LANES)), ir.IntType(64))
    return (types.int64(condition), generate) if condition == mask else None


@intrinsic
def total(context, vector):
    """The sum of the lanes: halves are added, then their halves, so that it is the same on all processors."""
    def generate(context, builder, sig, args):
        values, width = args[0], LANES
        while width > 1:
            width //= 2
            low, high = (builder.shuffle_vector(values, values, ir.Constant(ir.VectorType(I32, width), list(
                range(first, first + width)))) for first in (0, width))
            values = builder.fadd(low, high)
        return builder.extract_element(values, ir.Constant(I32, 0))
    return (float32(vector), generate) if vector == floats else None


# ---- Conversions

@intrinsic
def to_cell(context, vector, last):
    """The numbers without their fractions as `ints` from 0 to `last`; NaN is 0. Processors differ in others."""
    def generate(context, builder, sig, args):
        top = _spread(context, builder, args[1], last, floats)
        clamped = _larger("<")[floats](builder, _larger(">")[floats](
            builder, args[0], ir.Constant(args[0].type, [0.0] * LANES)), top)
        return builder.fptosi(clamped, ZEROS.type)
    return (ints(vector, last), generate) if vector == floats else None


@intrinsic
def to_floats(context, vector):
    return (floats(vector), lambda context, builder, sig, args: builder.sitofp(
        args[0], context.get_value_type(floats))) if vector == ints else None


@intrinsic
def bits_of(context, vector):
    """The bits of `floats` as `ints`, and the reverse."""
    kind = {floats: ints, ints: floats}.get(vector)
    return (kind(vector), lambda context, builder, sig, args: builder.bitcast(
        args[0], context.get_value_type(kind))) if kind else None


# ---- Memory

def _indexed(array, indices, result):
    """The signature of a function of an array and any number of indices, which numba passes as one tuple."""
    return result(array, types.StarArgTuple.from_types(indices))


def _unpacked(builder, sig, args):
    """(value, type) of each of the indices."""
    return list(zip(cgutils.unpack_tuple(builder, args[1]), sig.args[1].types))


def _pointer(context, builder, of, array, indices, vector=None):
    """The pointer to array[indices], or to the `vector` there; no index counts from the end, and none is checked."""
    place = cgutils.get_item_pointer(context, builder, of, context.make_array(of)(context, builder, array), [
        context.cast(builder, value, side, types.intp) for value, side in indices], wraparound=False)
    return builder.bitcast(place, context.get_value_type(vector).as_pointer()) if vector else place


@intrinsic
def load(context, array, *indices):
    """array[indices] and the LANES − 1 numbers after it, along the last axis."""
    kind = Vector(array.dtype)

    def generate(context, builder, sig, args):
        return builder.load(_pointer(context, builder, array, args[0], _unpacked(builder, sig, args), kind), align=4)
    return _indexed(array, indices, kind), generate


@intrinsic
def store(context, array, *indices_and_vector):
    """Write a vector, or a number, to array[indices] and the LANES − 1 places after it."""
    kind = Vector(array.dtype)

    def generate(context, builder, sig, args):
        *indices, (value, side) = _unpacked(builder, sig, args)
        builder.store(_spread(context, builder, value, side, kind),
                      _pointer(context, builder, array, args[0], indices, kind), align=4)
        return context.get_dummy_value()
    return _indexed(array, indices_and_vector, types.void), generate


@intrinsic
def gather(context, array, *indices):
    """array[indices] with `ints` among the indices: one number a lane."""
    kind = Vector(array.dtype)

    def generate(context, builder, sig, args):
        values, indices = ir.Constant(context.get_value_type(kind), ir.Undefined), _unpacked(builder, sig, args)
        for x in (ir.Constant(I32, x) for x in range(LANES)):
            at = [(builder.extract_element(value, x), int32) if side == ints else (value, side)
                  for value, side in indices]
            values = builder.insert_element(
                values, builder.load(_pointer(context, builder, array, args[0], at), align=4), x)
        return values
    return _indexed(array, indices, kind), generate


@intrinsic
def scatter(context, array, *indices_and_vector):
    """Write a vector to array[indices] with `ints` among the indices; of lanes with one place the last one stays."""
    def generate(context, builder, sig, args):
        *indices, (vector, _) = _unpacked(builder, sig, args)
        for x in (ir.Constant(I32, x) for x in range(LANES)):
            at = [(builder.extract_element(value, x), int32) if side == ints else (value, side)
                  for value, side in indices]
            builder.store(builder.extract_element(vector, x), _pointer(context, builder, array, args[0], at), align=4)
        return context.get_dummy_value()
    return _indexed(array, indices_and_vector, types.void), generate
