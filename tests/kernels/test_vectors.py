"""Vectors against NumPy, number by number: the functions below run compiled, and once more with NumPy's functions."""

from types import FunctionType

import numpy as np
from numba import njit

from srt3d_ros.kernels.cpu.spans import span, spanning
from srt3d_ros.kernels.cpu.vectors import (
    bits_of,
    floor,
    fma,
    full,
    lane_numbers,
    lanes_of,
    rint,
    sqrt,
    to_floats,
    to_ints,
    to_longs,
    total,
    where,
)
from srt3d_ros.kernels.maps import LANES

ODD = np.array([np.nan, np.inf, -np.inf, 0.0, -0.0, 1e-45, -3e-39, 1.2e-38, 3.4e38, -3.4e38, 0.5, -0.5, 1.5, 2.5, -2.5,
                1.0, -7.0, 8388609.0, 3e9, -3e9, 1 / 3], np.float32)
WHOLE = np.array([0, 1, -1, 5, -9, 2**31 - 1, -2**31, 1 << 23], np.int32)
SIZE = 28 * LANES           # holds all pairs
X, Y, I, J = (np.resize(side, SIZE) for side in (
    np.repeat(ODD, len(ODD)), np.tile(ODD, len(ODD)), np.repeat(WHOLE, len(WHOLE)), np.tile(WHOLE, len(WHOLE))))
Z = np.roll(np.resize(ODD[::-1], SIZE), 5)
TABLE = np.random.default_rng(0).normal(size=(2, 30)).astype(np.float32)
NUMBER = np.float32(1.3)


def floats_of(x, y, z, i, table, number):
    added, less, times = -x, -x, -x
    added += y
    less -= y
    times *= y
    at = max(min(i, 15), 0)
    return (
        x + y, x - y, x * y, x / y, -x, abs(x), added, less, times,
        x + 2, 2 - x, x * 0.1, 0.1 * x, 1 / x, x / 3, x - number, number * x,
        max(x, y), min(x, y), max(x, y, z), min(x, y, z, 1), max(x, 0), max(0, x), min(number, x),
        rint(x), floor(x), sqrt(x), where(x > y, x, z), where(x == y, 1, x), where(~(x >= 0) | (y < z), 2.5, 0),
        full(number), full(total(x)), full(total(table[0, span(7)])),
        to_floats(i), bits_of(bits_of(x)), table[1, at], table[min(at, 1), at + 3],
        full(rint(number)), full(floor(number)), full(sqrt(number)))


def ints_of(x, i, j, number):
    added = i + 0
    added += j
    return (
        i + j, i - j, i * j, added, i << 3, i >> 2, max(i, j), min(i, j), i + 1, 7 - i, i * 3,
        where(i < j, i, 3), full(4), bits_of(x), to_ints(x, 9), to_ints(x * 8, number), lane_numbers())


def masks_of(x, y, i, j):
    return (
        x < y, x <= y, x > y, x >= y, x == y, x != y, x > 0, 1 <= x, i < j, i <= j, i > j, i >= j, i == j, i != j,
        i == 0, (x < y) & (i < j), (x < y) | (i < j), ~(x < y), (x < y) & True)


def chain(larger):
    """`max`, or `min`, as vectors have it: of a NaN beside a number, what stands right."""
    def chosen(first, *more):
        for other in more:
            first = where_in_numpy(larger(first, other), first, other)
        return first
    return chosen


def total_in_numpy(values):
    while len(values) > 1:
        values = values[:len(values) // 2] + values[len(values) // 2:]
    return values[0]


def to_ints_in_numpy(values, last):
    above = np.where(values > 0, values, 0)
    return np.where(above < last, above, last).astype(np.int32)


def where_in_numpy(condition, one, other):
    kind = next((side.dtype for side in (one, other) if isinstance(side, np.ndarray)), np.float32)
    return np.where(condition, one, other).astype(kind)


IN_NUMPY = dict(
    max=chain(np.greater), min=chain(np.less), abs=np.abs, rint=np.rint, floor=np.floor, sqrt=np.sqrt,
    where=where_in_numpy, to_ints=to_ints_in_numpy, to_floats=np.float32, total=total_in_numpy,
    full=lambda number: np.full(LANES, number),
    bits_of=lambda values: values.view(np.int32 if values.dtype == np.float32 else np.float32),
    lane_numbers=lambda: np.arange(LANES, dtype=np.int32),
    span=lambda first: slice(first, first + LANES))


def in_numpy(function):
    return FunctionType(function.__code__, IN_NUMPY)


@njit
def fill(x, y, z, i, j, table, number, floats, ints, masks, fused, lanes):
    """Write what the functions above make of each vector into the rows of `floats`, `ints`, `masks`."""
    for at in range(0, x.size, LANES):
        columns = span(at + 1) - 1
        u, v, w, k, n = x[columns], y[columns], z[columns], i[columns], j[columns]
        for row, found in enumerate(of_floats(u, v, w, k, table, number)):
            floats[row, columns] = found
        for row, found in enumerate(of_ints(u, k, n, number)):
            ints[row, columns] = found
        for row, found in enumerate(of_masks(u, v, k, n)):
            masks[row, columns] = where(found, 1, 0)
        fused[columns] = fma(u, v, w)
        lanes[at // LANES] = lanes_of(u > v)


of_floats, of_ints, of_masks = (njit(error_model="numpy")(function) for function in (floats_of, ints_of, masks_of))


def assert_same(found, wanted, names):
    """The same numbers, zeros of the same sign; NaN at the same places."""
    for row, (one, other) in enumerate(zip(found, wanted, strict=True)):
        np.testing.assert_array_equal(one, other, err_msg=f"{names}[{row}]")
        np.testing.assert_array_equal(*(np.signbit(side)[~np.isnan(one)] for side in (one, other)))


def compare():
    """Hold compiled vectors against NumPy on this process' processor."""
    with np.errstate(all="ignore"):
        vectors = [[part[at:at + LANES] for part in (X, Y, Z, I, J)] for at in range(0, SIZE, LANES)]
        wanted = [[np.concatenate([np.asarray(each, kind) for each in rows]) for rows in zip(*made)] for kind, made in (
            (np.float32, [in_numpy(floats_of)(x, y, z, i, TABLE, NUMBER) for x, y, z, i, j in vectors]),
            (np.int32, [in_numpy(ints_of)(x, i, j, NUMBER) for x, y, z, i, j in vectors]),
            (np.float32, [in_numpy(masks_of)(x, y, i, j) for x, y, z, i, j in vectors]))]
        once, twice = np.float32(X.astype(float) * Y + Z), X * Y + Z
    floats, ints, masks = (np.zeros((len(rows), SIZE), rows[0].dtype) for rows in wanted)
    fused, lanes = np.zeros(SIZE, np.float32), np.zeros(SIZE // LANES, np.int64)
    fill(X, Y, Z, I, J, TABLE, NUMBER, floats, ints, masks, fused, lanes)
    for found, expected, names in zip((floats, ints, masks), wanted, ("floats_of", "ints_of", "masks_of")):
        assert_same(found, expected, names)
    rounded_once = np.isclose(fused, once, rtol=2.0**-23, atol=0, equal_nan=True)
    assert (rounded_once | (fused == twice) | (np.isnan(fused) & np.isnan(twice))).all()
    assert lanes.tolist() == ((X > Y).reshape(-1, LANES) * 2**np.arange(LANES)).sum(axis=1).tolist()


def test_each_function_is_numpys_on_this_processor():
    compare()


eight = spanning(8)


@njit
def add_longs(values, sums):
    sums[eight(0)] += to_longs(values[eight(0)])


def test_integers_of_32_bits_add_to_64_in_vectors_of_another_width():
    sums = np.append(2**40 * np.arange(-4, 4), 7)
    wanted = sums + np.append(WHOLE, 0)
    add_longs(WHOLE, sums)
    assert np.array_equal(sums, wanted)
