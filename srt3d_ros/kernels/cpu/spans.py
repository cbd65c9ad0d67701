"""Vectors in memory: array[…, j], where j are the columns of a vector (a Span), or `ints`, one place a lane.

    for j in columns(state):                            # j: the LANES columns of a vector
        depth = state[i, k, DEPTH, j]
        e = state[i, k, DEPTH, j + 1] - depth           # to the pixels on the right
        out[i, k, DEPTH, j] = where(e > 0, depth + e / 2, 0)

Indices are not checked, and none counts from the end.
"""

import operator

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.imputils import lower_builtin, lower_constant
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, register_model, typeof_impl
from numba.np.arrayobj import getitem_array_tuple

from srt3d_ros.kernels.cpu.vectors import I32, I64, Registers, Vector, emitted, ints
from srt3d_ros.kernels.maps import LANES, MARGIN


class Span(types.Type):
    """Index of `lanes` columns side by side; in LLVM, the first one. Numbers move it."""

    def __init__(self, lanes=LANES):
        self.lanes, self.registers = lanes, I64
        super().__init__(f"columns x{lanes}")


register_model(Span)(Registers)


def spanning(lanes):
    """A function that makes the index of so many columns from a first one on."""
    @intrinsic
    def span(context, first):
        return emitted(Span(lanes)(types.intp), lambda builder, first: first)
    return span


span = spanning(LANES)


class _All:
    """Index of the columns of an array with no more than LANES."""


ALL = _All()
typeof_impl.register(_All)(lambda value, context: Span())
lower_constant(Span)(lambda context, builder, kind, value: I64(0))


@intrinsic
def first_of(context, columns):
    """The first column of an index."""
    return emitted(types.intp(columns), lambda builder, first: first)


@njit(_nrt=False)
def columns(padded):
    """The indices of the vectors of a row of a padded map."""
    for first in range(MARGIN, padded.shape[-1] - MARGIN, LANES):
        yield span(first)


def _moving(key, emit):
    def generic(self, args, kws):
        is_moved = len(args) == 2 and isinstance(args[0], Span) and isinstance(args[1], types.Integer)
        return signature(args[0], args[0], types.intp) if is_moved else None

    infer_global(key)(type("Moved", (AbstractTemplate,), {"key": key, "generic": generic}))
    lower_builtin(key, Span, types.intp)(lambda context, builder, sig, args: emit(builder, *args))


_moving(operator.add, ir.IRBuilder.add)
_moving(operator.sub, ir.IRBuilder.sub)


def _indexing(key, result):
    """Define array[index], with a Span or `ints` among the indices, by its result and what it takes: result(vector)."""
    def generic(self, args, kws):
        array, index, *value = args
        indices = list(index) if isinstance(index, types.BaseTuple) else [index]
        lanes = [each.lanes for each in indices if isinstance(each, Span | Vector)]
        if isinstance(array, types.Array) and len(indices) == array.ndim and lanes:
            kinds = [each if isinstance(each, Span | Vector) else types.intp for each in indices]
            kind = Vector(array.dtype, lanes[0])
            index = types.BaseTuple.from_types(kinds) if isinstance(index, types.BaseTuple) else index
            return signature(result or kind, array, index, *[kind] * len(value))
        return None

    infer_global(key)(type("Indexed", (AbstractTemplate,), {"key": key, "generic": generic}))


def _pointers(context, builder, sig, args):
    """The pointer to array[index], or of each lane if `ints` are among the indices; none counts from the end."""
    array = context.make_array(sig.args[0])(context, builder, args[0])
    indices = cgutils.unpack_tuple(builder, args[1]) if isinstance(sig.args[1], types.BaseTuple) else [args[1]]

    def in_lane(index, x):
        return builder.sext(builder.extract_element(index, I32(x)), I64) if index.type == ints.registers else index

    lanes = LANES if any(index.type == ints.registers for index in indices) else 1
    return [cgutils.get_item_pointer(context, builder, sig.args[0], array, [in_lane(index, x) for index in indices],
                                     wraparound=False) for x in range(lanes)]


def _load(context, builder, sig, args):
    kind = sig.return_type
    if not isinstance(kind, Vector):
        return getitem_array_tuple(context, builder, sig, args)
    pointers = _pointers(context, builder, sig, args)
    if len(pointers) == 1:
        return builder.load(builder.bitcast(pointers[0], kind.registers.as_pointer()), align=4)
    values = ir.Constant(kind.registers, ir.Undefined)
    for x, pointer in enumerate(pointers):
        values = builder.insert_element(values, builder.load(pointer, align=4), I32(x))
    return values


def _store(context, builder, sig, args):
    """Of lanes with one place, the last one stays."""
    pointers, vector = _pointers(context, builder, sig, args), args[2]
    if len(pointers) == 1:
        builder.store(vector, builder.bitcast(pointers[0], vector.type.as_pointer()), align=4)
    else:
        for x, pointer in enumerate(pointers):
            builder.store(builder.extract_element(vector, I32(x)), pointer, align=4)


_indexing(operator.getitem, None)
_indexing(operator.setitem, types.none)
for _index in (types.BaseTuple, Span, Vector):
    lower_builtin(operator.getitem, types.Array, _index)(_load)
    lower_builtin(operator.setitem, types.Array, _index, Vector)(_store)
