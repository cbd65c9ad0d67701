"""What readers find in files of any size: a `Recording` gives histograms chunk by chunk; a `Survey` samples it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from srt3d_ros.core.progress import DELAY_S
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photons import PhotonEvents, PhotonHistograms
from srt3d_ros.datasets.values import MAX_PHOTONS, sendable
from srt3d_ros.errors import require

MAX_KEPT = 2**24            # photons of the sample: 100 MB. A recording with fewer is kept whole


class Counts(NamedTuple):
    """Histograms of whole rows: the first pixel; counts [pixels, n], numbers; the part of the file read so far."""

    first_pixel: int
    counts: np.ndarray
    done: float


@dataclass(frozen=True, eq=False)
class Recording:
    """What a reader finds in a file.

    Args:
        rows, cols, num_bins: size of the frame; num_bins: of a laser period, or of all that the file can hold.
        bin_width_s: seconds.
        chunks: begins to read the file anew, in bounded memory, as often as it is called.
        name: the file's name without its suffix.
        notes: one line each for what was assumed.
        given: what the file says of its sensor: irf, fov_deg, … by their names in `options.NAMES`.
        reference: depths that the file has, float32 [rows, cols], numbers of its bins.
    """

    rows: int
    cols: int
    num_bins: int
    bin_width_s: float
    chunks: Callable[[], Iterator[Counts]]
    name: str
    notes: tuple[str, ...] = ()
    given: dict = field(default_factory=dict)
    reference: np.ndarray | None = None


class StoredPhotons:
    """The photons of a recording that are in `bins` bins from `first` on: a first pass counts them and samples some.

    Attributes:
        photons: their number; of fractional counts, their sum. `outside`: the number of the others.
        countable: whether all counts are whole photons.
        sample: PhotonEvents of every step-th pixel; `sampled`: bool [rows, cols], those pixels.
        histogram, counts: float64 [T] and [rows, cols], photons of all pixels in each bin, and in each pixel.
    """

    def __init__(self, recording: Recording, first: int, bins: int):
        self._recording, self._first, self._bins = recording, first, bins
        rows, cols = recording.rows, recording.cols
        survey, total = Survey(rows * cols, bins), 0.0
        for chunk in self._chunks():
            part = self._inside(chunk)
            total += chunk.counts.sum(dtype=np.float64)
            survey.add_histograms(part.counts, part.first_pixel)
        self.photons, self.countable, self.sample = survey.photons, survey.countable, survey.sample
        self.outside = round(total - self.photons)
        self.sampled = np.arange(rows * cols).reshape(rows, cols) % survey.step == 0
        self.histogram, self.counts = survey.histogram, survey.counts.reshape(rows, cols)

    def check(self, sensor: SensorModel) -> None:
        """Raise InvalidInput unless the sensor has as many pixels and bins."""
        own = {"rows": self._recording.rows, "cols": self._recording.cols, "num_bins": self._bins}
        for name, value in own.items():
            found = getattr(sensor, name)
            require(found == value, name, found, f"{value}, as in {self._recording.name}")

    def packets(self) -> Iterator[PhotonHistograms]:
        """The photons from the first on, in bounded memory."""
        for chunk in self._chunks():
            part = self._inside(chunk)
            counts = np.pad(part.counts, ((0, 0), (0, self._bins - part.counts.shape[1])))     # of fewer bins than T
            counts = sendable(counts).reshape(-1, self._recording.cols, self._bins)
            yield PhotonHistograms(counts, first_row=part.first_pixel // self._recording.cols)

    @cached_property
    def frame(self) -> PhotonEvents:
        """All photons in memory; InvalidInput if they are more than MAX_PHOTONS, or fractional counts."""
        name = self._recording.name
        require(self.countable, f"{name} counts", "negative or fractional in places",
                "whole photons: only methods on sketches take others")
        require(self.photons <= MAX_PHOTONS, f"{name} photons", round(self.photons), f"at most {MAX_PHOTONS} in "
                "memory; methods on sketches take any number")
        parts = [events_of(self._inside(chunk).counts, chunk.first_pixel) for chunk in self._chunks()]
        return PhotonEvents(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("pixel", "toa")))

    def _chunks(self) -> Iterator[Counts]:
        """The file from its beginning; a progress bar on a terminal if it takes long."""
        from tqdm import tqdm  # here: it takes a tenth of `import srt3d_ros`

        with tqdm(desc=f"reading {self._recording.name}", total=100, delay=DELAY_S, disable=None, leave=False,
                  bar_format="{desc}: {percentage:3.0f} %|{bar}| {remaining}") as bar:
            for chunk in self._recording.chunks():
                bar.update(100 * chunk.done - bar.n)
                yield chunk

    def _inside(self, chunk: Counts) -> Counts:
        """The bins that are kept, which count from the first of them."""
        return chunk._replace(counts=chunk.counts[:, self._first:self._first + self._bins])


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
