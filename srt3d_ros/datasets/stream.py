"""Files of any size: a `Recording` gives photons or histograms chunk by chunk, a `PhotonStream` knows their sensor."""

from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from srt3d_ros.core.gate import Gate
from srt3d_ros.core.photons import PhotonEvents, PhotonHistograms
from srt3d_ros.core.progress import DELAY_S
from srt3d_ros.core.sensor import MAX_BINS, SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.sketching import Sketcher, sketch_photons
from srt3d_ros.datasets import irf as irfs
from srt3d_ros.datasets.photons import (
    ASSUMED_FOV,
    MAX_PHOTONS,
    Photons,
    described,
    number,
    outside_note,
    sendable,
    still_assumed,
)
from srt3d_ros.datasets.survey import Survey, events_of
from srt3d_ros.errors import require


class Events(NamedTuple):
    """Some photons: pixel, -1 outside, and ToA in bins, integers [N]; the part of the file read so far, 0 … 1."""

    pixel: np.ndarray
    toa: np.ndarray
    done: float


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
        chunks: begins to read the file anew, in bounded memory, as often as it is called; Events or else Counts.
        name: the file's name without its suffix.
        notes: one line each for what was assumed.
        given: what the file says of its sensor: irf, fov_deg, … by their names in `photons.OPTIONS`.
        reference: depths that the file has, float32 [rows, cols], numbers of its bins.
    """

    rows: int
    cols: int
    num_bins: int
    bin_width_s: float
    chunks: Callable[[], Iterator[Events | Counts]]
    name: str
    notes: tuple[str, ...] = ()
    given: dict = field(default_factory=dict)
    reference: np.ndarray | None = None


class PhotonStream:
    """The photons of a recording and their sensor; found by reading it once, and read again to be sketched.

    Args:
        options: what the file does not say, or says wrongly (photons.gather_options).
        guess_irf: take an IRF of one bin where none can be estimated, instead of refusing.

    Attributes:
        sensor, name, notes: as of Photons.
        photons: their number; of fractional counts, their sum.
        histogram, counts: float64 [T] and [rows, cols], photons of all pixels in each bin, and in each pixel.
        sample: Photons of some of the pixels (their sensor's mask says which), to choose gate and frequencies by.
        whole: all, if they are few enough to be kept; else, and for fractional counts, None.

    Raises:
        InvalidInput: the file or an option cannot be used.
    """

    def __init__(self, recording: Recording, options: dict, guess_irf: bool = False):
        self._recording, self.name = recording, recording.name
        options = recording.given | options
        bins = number("num_bins", options.get("num_bins", recording.num_bins), "a number of bins")
        self._first, self._bins = options.get("gate", (0, int(bins)))
        require(2 <= self._bins <= MAX_BINS, "num_bins", self._bins,
                f"2 to {MAX_BINS} bins: give num_bins, gate or bin_width_s")
        # Checked before anything is read.
        plain = SensorModel(recording.rows, recording.cols, self._bins, recording.bin_width_s, np.ones(1))
        survey, total = Survey(plain.pixels, self._bins), 0.0
        for chunk in self._chunks():
            part = self._inside(chunk)
            if isinstance(part, Counts):
                total += chunk.counts.sum(dtype=np.float64)
                survey.add_histograms(part.counts, part.first_pixel)
            else:
                total += np.count_nonzero(chunk.pixel >= 0)
                survey.add_events(part)
        self.photons, self._countable, events = survey.photons, survey.countable, survey.sample
        self.histogram, self.counts = survey.histogram, survey.counts.reshape(recording.rows, recording.cols)
        last, notes = self._first + self._bins - 1, recording.notes
        if "irf" not in options:
            options["irf"], note = irfs.estimated(events, self._bins, guess_irf)
            notes += (note,)
        notes += () if "fov_deg" in options else (ASSUMED_FOV,)
        self.sensor = described(plain, {name: value for name, value in options.items() if name != "num_bins"})
        self.sensor = self.sensor.replace(toa_offset_bins=self.sensor.toa_offset_bins + self._first)
        self.notes = notes + outside_note(round(total - self.photons), round(total), self._first, last)
        sampled = np.arange(plain.pixels).reshape(plain.rows, plain.cols) % survey.step == 0
        sample_sensor = self.sensor if survey.step == 1 else self.sensor.replace(mask=sampled)
        self.sample = Photons(sample_sensor, events, self._reference(), self.name, self.notes)
        self.whole = self.sample if self._countable and events.photons == self.photons else None

    def with_sensor(self, sensor: SensorModel) -> "PhotonStream":
        """The same photons, of a sensor with as many pixels and bins."""
        for name in ("rows", "cols", "num_bins"):
            own = getattr(self.sensor, name)
            require(getattr(sensor, name) == own, name, getattr(sensor, name), f"{own}, as in {self.name}")
        changed = copy(self)
        seen = self.sample.sensor.mask
        changed.sensor, changed.notes = sensor, still_assumed(self.notes, self.sensor, sensor)
        changed.sample = self.sample.with_sensor(sensor if seen is None else sensor.replace(
            mask=seen if sensor.mask is None else seen & sensor.mask))
        changed.whole = None if self.whole is None else changed.sample
        return changed

    def sketch(self, frequencies, gate: Gate | None = None) -> Sketch:
        """The sketch of all photons; reads the file a second time, in bounded memory."""
        sketcher, strips = None, []
        for chunk in self._chunks():
            part = self._inside(chunk)
            if isinstance(part, Counts):
                strips.append(self._strip(part.counts, frequencies, gate))
            else:
                sketcher = sketcher or Sketcher(self.sensor, frequencies, gate=gate)
                sketcher.add(part)
        if sketcher is not None:
            return sketcher.sketch()
        sums, photons = (np.concatenate([getattr(strip, name) for strip in strips]) for name in ("sums", "photons"))
        return Sketch(tuple(frequencies), sums, photons)

    def read_whole(self) -> Photons:
        """All photons in memory; InvalidInput if they are more than MAX_PHOTONS, or fractional counts."""
        if self.whole is not None:
            return self.whole
        require(self._countable, f"{self.name} counts", "negative or fractional in places",
                "whole photons: only methods on sketches take others")
        require(self.photons <= MAX_PHOTONS, f"{self.name} photons", round(self.photons), f"at most {MAX_PHOTONS} in "
                "memory; `srt3d reconstruct` reads any number, by a method on sketches")
        parts = [self._inside(chunk) for chunk in self._chunks()]
        parts = [events_of(part.counts, part.first_pixel) if isinstance(part, Counts) else part for part in parts]
        events = PhotonEvents(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("pixel", "toa")))
        return Photons(self.sensor, events, self.sample.reference_depth_bins, self.name, self.notes)

    def _chunks(self) -> Iterator[Events | Counts]:
        """The file from its beginning; a progress bar on a terminal if it takes long."""
        from tqdm import tqdm  # here: it takes a tenth of `import srt3d_ros`

        with tqdm(desc=f"reading {self.name}", total=100, delay=DELAY_S, disable=None, leave=False,
                  bar_format="{desc}: {percentage:3.0f} %|{bar}| {remaining}") as bar:
            for chunk in self._recording.chunks():
                bar.update(100 * chunk.done - bar.n)
                yield chunk

    def _inside(self, chunk: Events | Counts) -> PhotonEvents | Counts:
        """What of a chunk is in a pixel and in one of the bins that are kept, which count from the first of them."""
        end = self._first + self._bins
        if isinstance(chunk, Counts):
            return chunk._replace(counts=chunk.counts[:, self._first:end])
        kept = (chunk.pixel >= 0) & (chunk.toa >= self._first) & (chunk.toa < end)
        return PhotonEvents(chunk.pixel[kept].astype(np.uint32), (chunk.toa[kept] - self._first).astype(np.uint16))

    def _strip(self, counts: np.ndarray, frequencies, gate: Gate | None) -> Sketch:
        """The sketch of some rows; histograms of fewer than T bins have the first ones."""
        counts = sendable(np.pad(counts, ((0, 0), (0, self._bins - counts.shape[1]))))
        counts = counts.reshape(-1, self.sensor.cols, self._bins)
        strip = SensorModel(len(counts), self.sensor.cols, self._bins, self.sensor.bin_width_s, np.ones(1),
                            toa_reference=self.sensor.toa_reference)
        return sketch_photons(PhotonHistograms(counts), strip, frequencies,
                              None if gate is None else Gate(strip, gate.first, gate.last))

    def _reference(self) -> np.ndarray | None:
        if self._recording.reference is None:
            return None
        depth = self._recording.reference - np.float32(self._first)
        depth = np.where((depth >= 0) & (depth < self._bins), depth, np.float32(np.nan))
        return depth[None] + np.float32(self.sensor.first_bin_center)
