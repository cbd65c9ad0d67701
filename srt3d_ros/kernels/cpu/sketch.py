"""Photons → sketch where torch has nothing ready: unsorted photons, float ToA, gates."""

import numpy as np
from numba import njit, prange


@njit(cache=True)
def _sketch_unsorted(pixel, toa, table, sums, photons):
    for p in range(len(pixel)):
        photons[pixel[p]] += 1
        for c in range(table.shape[1]):
            sums[pixel[p], c] += table[toa[p], c]


def sketch_unsorted(pixel, toa, table, pixels):
    """Sums of table rows per pixel, photons in any order.

    Args:
        pixel: uint32 [N].
        toa: unsigned integers [N], below T.
        table: float32 [T, 2m], exp(i ω_l b) interleaved.
        pixels: number of pixels.

    Returns:
        float64 [pixels, 2m] and int64 [pixels].
    """
    sums, photons = np.zeros((pixels, table.shape[1])), np.zeros(pixels, np.int64)
    _sketch_unsorted(pixel, toa, table, sums, photons)
    return sums, photons


@njit(cache=True)
def _sketch_continuous(pixel, toa, omegas, sums, photons):
    for p in range(len(pixel)):
        photons[pixel[p]] += 1
        for l in range(len(omegas)):
            phase = omegas[l] * toa[p]
            sums[pixel[p], 2 * l] += np.cos(phase)
            sums[pixel[p], 2 * l + 1] += np.sin(phase)


def sketch_continuous(pixel, toa, omegas, pixels):
    """As `sketch_unsorted` for float32 ToA; omegas: float64 [m], radians per bin."""
    sums, photons = np.zeros((pixels, 2 * len(omegas))), np.zeros(pixels, np.int64)
    _sketch_continuous(pixel, toa, omegas, sums, photons)
    return sums, photons


@njit(parallel=True, cache=True)
def _sketch_gates(words, table, first_word, no_detection, sums, photons, stray):
    gates, pixels = words.shape
    strips = len(stray)
    for strip in prange(strips):
        for g in range(gates):
            for p in range(strip * pixels // strips, (strip + 1) * pixels // strips):
                word = np.int64(words[g, p])
                if word == no_detection:
                    continue
                b = word - first_word
                if b < 0 or b >= len(table):
                    stray[strip] = word
                    continue
                photons[p] += 1
                for c in range(table.shape[1]):
                    sums[p, c] += table[b, c]


def sketch_gates(words, table, first_word, no_detection):
    """Sums of table rows per pixel from the ToA words of a gated array.

    Args:
        words: uint16 [G, pixels].

    Returns:
        float64 [pixels, 2m], int64 [pixels], and a word that is neither a bin nor `no_detection`, or −1.
    """
    pixels = words.shape[1]
    sums, photons = np.zeros((pixels, table.shape[1])), np.zeros(pixels, np.int64)
    stray = np.full(min(pixels, 16), -1, np.int64)     # strips of pixels: one cache-sized accumulator a thread
    _sketch_gates(words, table, first_word, no_detection, sums, photons, stray)
    return sums, photons, int(stray.max())


