"""Sums of a sketch in few bytes: rounded to a fraction of their photon noise, less what one surface explains.

The sums of n photons have a standard deviation of σ = √(n/2) in each part, re and im: digits below a fraction of it say
nothing. Most pixels see one surface: one of their photons is at a position p and the others around it, so that sums_l ≈
(1 + (n − 1) a_l) exp(i ω_l p), with gains a_l that all pixels share (IRF and share of signal). p alone then says what m
numbers would repeat, and what it leaves of them is rounded. The encoder searches for p; the decoder need not know how,
nor the IRF. Pixels that p explains badly have none.
"""

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from srt3d_ros.core.sketching.sketch import Sketch
from srt3d_ros.errors import require

MAX_DIGITS = 6          # of the largest number, √(2 · MAX_PHOTONS) / 0.1 < 2²⁰
POSITIONS = 16          # in a period of the highest frequency, whose phase is then off by 0.11 rad (rms)
MAX_POSITIONS = 2**14   # a difference of two, its sign and "none" are two bytes
SEARCHED = 4            # one of so many positions is tried for a block
BLOCK = 4               # pixels along the side of a block
SOME = 2048             # pixels are enough for a mean
ENOUGH = 8.0            # energy in σ² that a position must explain: it costs a byte, as much as that much energy does
TILE = 4096             # pixels at once: what is computed of them stays in the cache
DIGIT_PAIRS = np.stack([np.arange(256) % 16 - 8, np.arange(256) // 16 - 8], axis=1).astype(np.float32)
OFFSET = 0x888888       # added to a number, its digits −8 … 7 become hexadecimal ones
ZERO = 0x88             # two digits 0
TINY = 1e-9
ROUNDED = 0.708         # of a step: how far rounding moves a complex number at most, 1/√2
LONGEST = 1.001         # sum of n unit vectors, over n; the rest is for rounding


class RoundedSums(NamedTuple):
    """What is kept of the sums of P pixels, as msg_schemas/sketch.json has it.

    Args:
        gains: a_l, complex64 [m].
        positions: uint16 [P], 0 for a pixel without one, else the difference to the last one.
        digits: uint8 [d, m, P], by digit, l and pixel: −8 … 7 of re, plus 8, and 16 times that of im.
    """

    gains: np.ndarray
    positions: np.ndarray
    digits: np.ndarray


def rounded(sketch: Sketch, step: float) -> RoundedSums:
    """The sums of a sketch, rounded to multiples of step · √(n/2); InvalidInput if so many photons cannot have them."""
    m = sketch.sums.shape[2]
    counts = np.ascontiguousarray(sketch.photons, "<u4").reshape(-1)
    sums, n = np.ascontiguousarray(sketch.sums, np.complex64), counts.astype(np.float32)
    for tile in _tiles(len(n)):
        _check_lengths(sums.reshape(-1, m)[tile].view(np.float32), LONGEST * n[tile])
    roots = _roots(sketch.frequencies)
    positions, gains = _block_positions(sums.view(np.float32), n, roots)
    sums, some = sums.reshape(-1, m), slice(None, None, 1 + len(n) // SOME)
    refined = _refined(sums[some], n[some], positions[some], _Slopes(roots, gains))
    gains = _gains(sums[some], n[some], refined, roots)
    used, planes = _round(sums, n, positions, roots, gains, _steps(counts, step))
    return RoundedSums(gains, _differences(positions, used), np.stack(planes))


def restored(coded: RoundedSums, counts: np.ndarray, frequencies: tuple[int, ...], step: float) -> np.ndarray:
    """Sums, complex64 [P, m], of pixels with so many photons; InvalidInput if these cannot have such ones."""
    used, positions = _positions(coded.positions.astype(np.int32))
    predict = _Prediction(_roots(frequencies), coded.gains)
    return _restored(counts, coded.digits, used, positions, predict, _steps(counts, step))


def _round(sums, n, positions, roots, gains, steps) -> tuple[np.ndarray, list[np.ndarray]]:
    """Whether positions, which are refined in place, explain enough; digits of what is left, each uint8 [m, pixels]."""
    slopes, predict = _Slopes(roots, gains), _Prediction(roots, gains)
    used, planes = np.zeros(len(n), bool), []
    for tile in _tiles(len(n)):
        parts = sums[tile].view(np.float32)
        positions[tile] = _refined(sums[tile], n[tile], positions[tile], slopes)
        expected = predict(n[tile], positions[tile])
        used[tile] = _dot(2 * parts - expected, expected) > ENOUGH / 2 * n[tile]
        expected *= used[tile, None]
        rest = np.subtract(parts, expected, out=expected)
        rest /= steps[tile, None]
        np.rint(rest, out=rest)
        digits = _digits(max(float(rest.max()), -float(rest.min())))
        planes += [np.full((sums.shape[1], len(n)), ZERO, np.uint8) for _ in range(digits - len(planes))]
        numbers = rest.astype(np.int32) + OFFSET
        for k in range(digits):
            pairs = ((numbers >> 4 * k).astype(np.uint8) & 15).view("<u2")
            planes[k][:, tile] = (pairs | pairs >> 4).astype(np.uint8).T
    return used, planes


def _restored(counts, planes, used, positions, predict, steps) -> np.ndarray:
    """Sums, complex64 [pixels, m], of digits uint8 [digits, m, pixels]; InvalidInput if no photons have such ones."""
    digits, m, pixels = planes.shape
    sums = np.empty((pixels, m), np.complex64)
    for tile in _tiles(pixels):
        n = counts[tile].astype(np.float32)
        parts = DIGIT_PAIRS.take(planes[0, :, tile].T, axis=0).reshape(len(n), 2 * m)
        for k in range(1, digits):
            if (planes[k, :, tile] != ZERO).any():
                parts += (16**k * DIGIT_PAIRS).take(planes[k, :, tile].T, axis=0).reshape(parts.shape)
        parts *= steps[tile, None]
        parts += predict(n, positions[tile]) * used[tile, None]
        length2 = _check_lengths(parts, LONGEST * n + ROUNDED * steps[tile])
        # No sum of n unit vectors is longer than n: the nearest that is possible is nearer to what was rounded.
        n = n[:, None]
        np.multiply(parts.view(np.complex64), n / np.sqrt(np.maximum(length2, np.maximum(n, 1)**2)), out=sums[tile])
    return sums


def _block_positions(parts: np.ndarray, n: np.ndarray, roots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of each pixel the position that explains most of its block's sums, int64 [pixels]; the gains."""
    rows, cols, width = parts.shape
    parts = _pooled(np.ascontiguousarray(_pooled(parts).swapaxes(0, 1))).swapaxes(0, 1)
    filters = np.ascontiguousarray(roots[::SEARCHED].view(np.float32).T)
    found = np.stack([(some @ filters).argmax(axis=-1) for some in parts]) * SEARCHED
    gains = _gains(parts.reshape(-1, width).view(np.complex64), n, found.reshape(-1), roots)
    return found.repeat(BLOCK, 0)[:rows].repeat(BLOCK, 1)[:, :cols].reshape(-1), gains


def _pooled(values: np.ndarray) -> np.ndarray:
    """Sums over every BLOCK along the first axis, and over the rest."""
    whole = len(values) // BLOCK * BLOCK
    sums = values[:whole].reshape(-1, BLOCK, *values.shape[1:]).sum(axis=1)
    return sums if whole == len(values) else np.concatenate([sums, values[whole:].sum(axis=0, keepdims=True)])


class _Slopes:
    """Derivatives of the data term Σ_l |sums_l − (1 + (n − 1) a_l) exp(i ω_l p)|² in p."""

    def __init__(self, roots: np.ndarray, gains: np.ndarray):
        omega = np.angle(roots[1].astype(complex))
        self.table = (np.complex64(1j) * (omega * gains).astype(np.complex64) * roots).view(np.float32)
        self.one, self.more = (float((omega**2 * np.abs(gains)**power).sum()) + TINY for power in (1, 2))


def _refined(sums, n, positions, slopes: _Slopes) -> np.ndarray:
    """Positions after a step of Gauss and Newton."""
    step = _dot(sums.view(np.float32), slopes.table.take(positions, axis=0))
    step /= slopes.one + slopes.more * np.maximum(n - 1, 0)
    return (positions + np.rint(step).astype(np.int64)) & (len(slopes.table) - 1)


class _Prediction:
    """Sums of n photons at a position, of which one is known to be there: (1 + (n − 1) a_l) exp(i ω_l p)."""

    def __init__(self, roots: np.ndarray, gains: np.ndarray):
        self.one, self.more = roots.view(np.float32), (roots * gains).astype(np.complex64).view(np.float32)

    def __call__(self, n: np.ndarray, positions: np.ndarray) -> np.ndarray:
        """float32 [pixels, 2m]; positions count modulo their number."""
        positions = positions & len(self.one) - 1
        parts = self.more.take(positions, axis=0)
        parts *= (n - 1)[:, None]
        parts += self.one.take(positions, axis=0)
        return parts


def _gains(sums, n, positions, roots) -> np.ndarray:
    """a_l by least squares, complex64 [m]."""
    turned = np.einsum("pm,pm->m", sums, roots.take(positions, axis=0).conj())
    return (turned / max(float(n.sum(dtype=np.float64)), 1)).astype(np.complex64)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Σ_j a_pj b_pj."""
    return (a * b) @ np.ones(b.shape[1], np.float32)


@lru_cache(maxsize=2)
def _roots(frequencies: tuple[int, ...]) -> np.ndarray:
    """exp(i ω_l p) at all positions p, complex64 [positions, m]."""
    count = min(1 << (POSITIONS * max(frequencies) - 1).bit_length(), MAX_POSITIONS)
    turns = np.outer(np.arange(count), frequencies) % count / count
    return np.exp(2j * np.pi * turns).astype(np.complex64)


def _steps(counts: np.ndarray, step: float) -> np.ndarray:
    """What the numbers of each pixel are multiples of, float32: the same for encoder and decoder."""
    return np.float32(step) * np.sqrt(np.maximum(counts, 1).astype(np.float32) / 2)


def _digits(largest: float) -> int:
    """How many digits −8 … 7 of base 16 make the numbers up to ± largest."""
    return next(count for count in range(1, MAX_DIGITS + 1) if largest <= 7 * (16**count - 1) // 15)


def _check_lengths(parts: np.ndarray, longest: np.ndarray) -> np.ndarray:
    """Squared lengths of sums, [pixels, m]; InvalidInput if one is above its pixel's longest, or not a number."""
    squares = parts * parts
    length2 = squares[:, 0::2] + squares[:, 1::2]
    require(bool((length2 <= np.square(longest)[:, None]).all()), "sketch", f"up to {np.sqrt(length2.max()):g} long",
            "sums of unit vectors, as many as photons")
    return length2


def _differences(positions: np.ndarray, used: np.ndarray) -> np.ndarray:
    """0 without a position; else the difference to the last one, 0, −1, 1, −2 … as 1, 2, 3, 4 …; uint16."""
    difference = np.diff(positions[used], prepend=0)
    coded = np.zeros(len(positions), "<u2")
    coded[used] = np.where(difference < 0, -2 * difference, 2 * difference + 1)
    return coded


def _positions(coded: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What `_differences` says: whether there is a position, and which, but for whole rounds."""
    used = coded > 0
    return used, np.cumsum(np.where(coded % 2 == 1, coded // 2, -(coded // 2)) * used)


def _tiles(pixels: int) -> Iterator[slice]:
    return (slice(first, first + TILE) for first in range(0, pixels, TILE))
