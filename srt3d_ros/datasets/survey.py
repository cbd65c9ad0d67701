"""Survey: what a first pass over a recording finds, in bounded memory; a sample of its photons among it."""

import numpy as np

from srt3d_ros.core.sketching.photons import PhotonEvents

MAX_KEPT = 2**24            # photons of the sample: 100 MB. A recording with fewer is kept whole


class Survey:
    """Counts the photons of a recording, chunk by chunk, and keeps those of some pixels.

    Attributes:
        photons: number of photons; of fractional counts, their sum.
        histogram, counts: float64 [T] and [rows · cols], photons of all pixels in each bin, and in each pixel.
        countable: whether all counts were whole photons.
        step: from one pixel of the sample to the next, a power of two; 1: all pixels.
    """

    def __init__(self, pixels: int, bins: int):
        self.photons, self.countable, self.step = 0, True, 1
        self.histogram, self.counts = np.zeros(bins), np.zeros(pixels)
        self._pixels, self._parts = pixels, []

    @property
    def sample(self) -> PhotonEvents:
        """All photons of every step-th pixel; of a single pixel with more than MAX_KEPT some of them."""
        pixel = np.concatenate([part.pixel for part in self._parts] or [np.zeros(0, np.uint32)])
        toa = np.concatenate([part.toa for part in self._parts] or [np.zeros(0, np.uint16)])
        return PhotonEvents(pixel, toa)

    def add_histograms(self, counts: np.ndarray, first: int) -> None:
        """Add counts [n, bins] of the pixels from `first` on."""
        own = counts.sum(axis=1, dtype=np.float64)
        self.photons += own.sum()
        self.histogram[:counts.shape[1]] += counts.sum(axis=0, dtype=np.float64)
        self.counts[first:first + len(counts)] += own
        self.countable &= counts.dtype.kind in "ub" or bool((counts >= 0).all() and (counts == np.floor(counts)).all())
        sampled = counts[-first % self.step::self.step]
        while (most := np.maximum(sampled, 0).sum(dtype=np.float64)) > MAX_KEPT and self.step < self._pixels:
            self.step *= 2
            sampled = counts[-first % self.step::self.step]
        sampled = sampled if most <= MAX_KEPT else np.floor(sampled * (MAX_KEPT / most))
        self._keep(events_of(sampled, first + -first % self.step, self.step))

    def _keep(self, part: PhotonEvents) -> None:
        self._parts.append(part)
        while (kept := sum(part.photons for part in self._parts)) > MAX_KEPT and self.step < self._pixels:
            self.step *= 2
            self._parts = [part.part(part.pixel & np.uint32(self.step - 1) == 0) for part in self._parts]
        if kept > MAX_KEPT:
            self._parts.pop()


def events_of(counts: np.ndarray, first: int = 0, step: int = 1) -> PhotonEvents:
    """Counts [n, bins] of the pixels `first`, `first` + `step`, … as photons; negative ones are none."""
    at = np.flatnonzero(counts)
    photons = np.rint(np.maximum(counts.reshape(-1)[at], 0)).astype(np.int64)
    pixel, toa = np.divmod(at, max(counts.shape[1], 1))
    return PhotonEvents((first + step * pixel).astype(np.uint32).repeat(photons), toa.astype(np.uint16).repeat(photons))
