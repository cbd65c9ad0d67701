"""Vectors for compiled code: LANES numbers in registers, with the operators of numbers.

Kinds are `floats` (float32), `ints` (int32) and `mask`. A number beside a vector counts in each lane, as its type.
Sums of integers have vectors of other widths, too, and of int64.
LLVM splits a vector into what the processor has (SSE2, AVX2, AVX-512, NEON); 8 lanes were slower on all of them.
Nothing is contracted but `fma`, which rounds once where the processor can: a kernel gives the same bits whether it was
compiled or read from the disk, on one thread or many. NumPy has the same results for all but `fma`, `max` and `min`.
"""

import operator
from functools import partial, reduce

from llvmlite import ir
from numba import boolean, float32, int32, int64, types
from numba.core import cgutils
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, models, register_model

from srt3d_ros.kernels.maps import LANES

I32, I64 = ir.IntType(32), ir.IntType(64)
BITS = {float32: ir.FloatType(), int32: I32, int64: I64, boolean: ir.IntType(1)}
# What may stand beside a vector
NUMBERS = {float32: types.Number, int32: types.Integer, int64: types.Integer, boolean: types.Boolean}


class Vector(types.Type):
    """`lanes` values of the type `lane`; in LLVM, `registers`."""

    def __init__(self, lane, lanes=LANES):
        self.lane, self.lanes, self.registers = lane, lanes, ir.VectorType(BITS[lane], lanes)
        super().__init__(f"{lane}x{lanes}")


@register_model(Vector)
class Registers(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, kind.registers)


floats, ints, mask = Vector(float32), Vector(int32), Vector(boolean)


def _kind(sides):
    """The vector that the sides of an operator are, or stand beside; None if they do not fit."""
    kind = next((side for side in sides if isinstance(side, Vector)), None)
    fits = kind and all(side == kind or isinstance(side, NUMBERS[kind.lane]) for side in sides)
    return kind if fits else None


@lower_cast(types.Number, Vector)
@lower_cast(types.Boolean, Vector)
def _spread(context, builder, side, kind, number):
    """A vector with a number in each of its lanes: what numba passes where a signature has a vector."""
    nothing = ir.Constant(kind.registers, ir.Undefined)
    first = builder.insert_element(nothing, context.cast(builder, number, side, kind.lane), I32(0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(I32, kind.lanes), None))


# ---- Operators

def _define(key, emits, result=None):
    """Define an operator by what it emits for each type of lanes: emits = {type: function of builder and vectors}.

    Its result has the same kind, or `result`.
    """
    def generic(self, args, kws):
        kind = _kind(args)
        return signature(result or kind, *[kind] * len(args)) if kind and kind.lane in emits else None

    def lower(context, builder, sig, vectors):
        return emits[sig.args[0].lane](builder, *vectors)

    infer_global(key)(type(f"Vector_{key.__name__}", (AbstractTemplate,), {"key": key, "generic": generic}))
    for number in range(1, 5):      # max and min have up to four sides
        lower_builtin(key, *[Vector] * number)(lower)


def _call(name, builder, *values):
    """A call of LLVM's own function for float32 or `floats`."""
    of = values[0].type
    suffix = f"v{LANES}f32" if isinstance(of, ir.VectorType) else "f32"
    return builder.call(cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(of, [of] * len(values)), f"llvm.{name}.{suffix}"), values)


def _compare(sign):
    def compare(builder, x, y):
        return (builder.fcmp_unordered if sign == "!=" else builder.fcmp_ordered)(sign, x, y)
    return {float32: compare, int32: lambda builder, x, y: builder.icmp_signed(sign, x, y)}


def _choose(sign):
    """`max` or `min`: x if x is larger (smaller) than y, else y, as processors do: of a NaN beside a number, y."""
    def choose(compare, builder, *vectors):
        return reduce(lambda x, y: builder.select(compare(builder, x, y), x, y), vectors)
    return {lane: partial(choose, compare) for lane, compare in _compare(sign).items()}


_make = ir.IRBuilder
for _names, _emits in (
        ("add iadd", {float32: _make.fadd, int32: _make.add, int64: _make.add}),
        ("sub isub", {float32: _make.fsub, int32: _make.sub}),
        ("mul imul", {float32: _make.fmul, int32: _make.mul}),
        ("truediv", {float32: _make.fdiv}),
        ("lshift", {int32: _make.shl}),
        ("rshift", {int32: _make.ashr}),
        ("and_ iand", {boolean: _make.and_}),
        ("or_ ior", {boolean: _make.or_}),
        ("invert", {boolean: _make.not_}),
        ("neg", {float32: _make.fneg})):
    for _name in _names.split():
        _define(getattr(operator, _name), _emits)
for _name, _sign in (("lt", "<"), ("le", "<="), ("gt", ">"), ("ge", ">="), ("eq", "=="), ("ne", "!=")):
    _define(getattr(operator, _name), _compare(_sign), mask)
_define(max, _choose(">"))
_define(min, _choose("<"))
_define(abs, {float32: partial(_call, "fabs")})


# ---- Functions

def emitted(sig, emit):
    """What an intrinsic returns: its signature, and what it emits as a function of builder and values."""
    return sig, lambda context, builder, sig, values: emit(builder, *values)


def _of_one(name):
    """A function of `floats`, or of one float32."""
    @intrinsic
    def apply(context, x):
        kind = floats if x == floats else float32
        return emitted(kind(kind), partial(_call, name))
    return apply


rint, floor, sqrt = map(_of_one, ("rint", "floor", "sqrt"))


@intrinsic
def fma(context, a, b, c):
    """a · b + c, of vectors or of numbers, rounded once where the processor has an instruction for it."""
    kind = floats if floats in (a, b, c) else float32
    return emitted(kind(kind, kind, kind), partial(_call, "fmuladd"))


@intrinsic
def where(context, condition, a, b):
    """a in the lanes in which the condition holds, else b; of a named tuple of vectors, field by field."""
    if isinstance(a, types.NamedUniTuple):
        def choose(builder, condition, *sides):
            fields = ([builder.extract_value(side, n) if isinstance(side.type, ir.ArrayType) else side
                       for n in range(a.count)] for side in sides)
            return cgutils.pack_array(builder, [builder.select(condition, x, y) for x, y in zip(*fields)])
        return emitted(a(mask, a, a if a == b else a.dtype), choose)
    kind = _kind((a, b)) or floats
    return emitted(kind(mask, kind, kind), _make.select)


@intrinsic
def full(context, number):
    """A number in each lane."""
    kind = floats if isinstance(number, types.Float) else ints if isinstance(number, types.Integer) else mask
    return emitted(kind(kind), lambda builder, vector: vector)


@intrinsic
def lane_numbers(context):
    """The `ints` 0, 1, 2 …"""
    return emitted(ints(), lambda builder: ir.Constant(ints.registers, list(range(LANES))))


@intrinsic
def lanes_of(context, condition):
    """The lanes in which a condition holds, as the bits of a number; 0: in none."""
    return emitted(types.int64(mask), lambda builder, bits: builder.zext(
        builder.bitcast(bits, ir.IntType(LANES)), I64))


@intrinsic
def total(context, vector):
    """The sum of the lanes: halves are added, then their halves, so that it is the same on all processors."""
    def add(builder, values):
        width = LANES
        while width > 1:
            width //= 2
            low, high = (builder.shuffle_vector(values, values, ir.Constant(ir.VectorType(I32, width), list(
                range(first, first + width)))) for first in (0, width))
            values = builder.fadd(low, high)
        return builder.extract_element(values, I32(0))
    return emitted(float32(floats), add)


@intrinsic
def to_ints(context, vector, last):
    """The numbers without their fractions as `ints` from 0 to `last`; NaN is 0. Processors differ in others."""
    def convert(builder, values, top):
        from_zero = _choose(">")[float32](builder, values, ir.Constant(values.type, [0.0] * LANES))
        return builder.fptosi(_choose("<")[float32](builder, from_zero, top), ints.registers)
    return emitted(ints(floats, floats), convert)


@intrinsic
def to_floats(context, vector):
    """The `ints` as `floats`."""
    return emitted(floats(ints), lambda builder, values: builder.sitofp(values, floats.registers))


@intrinsic
def to_longs(context, vector):
    """Integers of 32 bits as those of 64."""
    kind = Vector(int64, vector.lanes)
    return emitted(kind(vector), lambda builder, values: builder.sext(values, kind.registers))


@intrinsic
def bits_of(context, vector):
    """The bits of `floats` as `ints`, and the reverse."""
    kind = {floats: ints, ints: floats}.get(vector)
    return emitted(kind(vector), lambda builder, values: builder.bitcast(values, kind.registers)) if kind else None
