"""Photons → sketch: the part of `kernels.api` that `core.sketching` uses.

Sums are complex128 [pixels, m] here, rows complex128 [T, m].
"""

import numpy as np

from srt3d_ros.kernels.constants import MAX_PHOTONS


def new_sums(pixels, values):
    return np.zeros((pixels, values // 2), complex), np.zeros(pixels, np.int64)


def fixed_rows(table):
    return table.astype(np.float64).view(complex)


def read_sums(sums, photons, values):
    share = MAX_PHOTONS / np.maximum(photons, MAX_PHOTONS)
    z = (sums[:, :values // 2] * share[:, None]).astype(np.complex64)
    return z, np.minimum(photons, MAX_PHOTONS).astype(np.uint32)


def counted(sums, column):
    return np.rint(sums[:, column // 2].real).astype(np.int64)


def inspect_events(pixel, toa, pixels, num_bins):
    inside = (pixel < pixels) & (toa >= 0) & (toa < num_bins)
    return bool(inside.all()), bool((pixel[1:] >= pixel[:-1]).all())


def find_stray(words, first_word, no_detection, num_bins):
    bins = words.astype(int) - first_word
    stray = (words != no_detection) & ((bins < 0) | (bins >= num_bins))
    return int(words[stray].max()) if stray.any() else -1


def sketch_unsorted(pixel, toa, rows, sums, photons):
    for p, x in zip(pixel, toa):
        sums[p] += rows[x]
        photons[p] += 1


sketch_sorted = sketch_unsorted


def sketch_continuous(pixel, toa, frequencies, num_bins, ordered, sums, photons):
    omega = 2 * np.pi * np.asarray(frequencies) / num_bins
    for p, x in zip(pixel, toa.astype(np.float64)):
        sums[p] += np.exp(1j * omega * x)
        photons[p] += 1


def sketch_gates(words, rows, first_word, no_detection, sums, photons):
    cycle, pixel = np.nonzero(words != no_detection)
    sketch_unsorted(pixel, words[cycle, pixel].astype(int) - first_word, rows, sums, photons)


def sketch_histograms(counts, table, of_template, sums, photons):
    product = np.matmul(counts[:, None].astype(float), table.astype(float))[:, 0]
    product = (product if of_template is None else product - of_template).view(complex)
    sums += product[:, :sums.shape[1]]
    photons += np.rint(np.maximum(product[:, -1].real, 0)).astype(np.int64)
