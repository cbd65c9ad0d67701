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
from srt3d_ros.core.sketching import Sketcher
from srt3d_ros.datasets.photons import MAX_PHOTONS, Photons, described, number, outside_note, still_assumed
from srt3d_ros.datasets.survey import Survey, events_of
from srt3d_ros.errors import require


class Events(NamedTuple):
    """Some photons: pixel, -1 outside, and ToA in bins, integers [N]; the part of the file read so far, 0 … 1."""

    pixel: np.ndarray
    toa: np.ndarray
    done: float


class Rows(NamedTuple):
    """Histograms of some rows: the index of the first; counts [r, cols, n], numbers; the part of the file read."""

    first_row: int
    counts: np.ndarray
    done: float


@dataclass(frozen=True, eq=False)
class Recording:
    """What a reader finds in a file.

    Args:
        rows, cols, num_bins: size of the frame; num_bins: of a laser period, or of all that the file can hold.
        bin_width_s: seconds.
        chunks: begins to read the file anew, in bounded memory, as often as it is called; gives either Events or Rows.
        name: the file's name without its suffix.
        notes: one line each for what was assumed.
        given: what the file says of its sensor: irf, fov_deg, … by their names in `photons.OPTIONS`.
    """

    rows: int
    cols: int
    num_bins: int
    bin_width_s: float
    chunks: Callable[[], Iterator[Events | Rows]]
    name: str
    notes: tuple[str, ...] = ()
    given: dict = field(default_factory=dict)


class PhotonStream:
    """The photons of a recording and their sensor. Opening it reads the file once, in bounded memory.

    Args:
        recording: of a reader.
        options: as from `photons.gather_options`; they win over what the file says.
        guess_irf: take an IRF of one bin where none can be estimated, and say so, instead of refusing.

    Attributes:
        sensor: SensorModel.
        notes: one line each for what was assumed, estimated or left out.
        photons: number of photons inside pixels and gate; of fractional counts, their sum.
        histogram, counts: float64 [T] and [rows, cols], photons of all pixels in each bin, and in each pixel.
        sample: Photons of some pixels, those that its sensor does not mask, to choose frequencies by.
        whole: all Photons if they are few enough to be kept (survey.MAX_KEPT), else None.

    Raises:
        InvalidInput: naming the option or the part of the file that cannot be used.
    """

    def __init__(self, recording: Recording, options: dict, guess_irf: bool = False):
        self._recording, self.name = recording, recording.name
        options = recording.given | options
        self._first, self._bins = options.get("gate", (0, self._num_bins(options)))
        # Checked before anything is read.
        plain = SensorModel(recording.rows, recording.cols, self._bins, recording.bin_width_s, np.ones(1))
        survey, outside = self._survey()
        self.photons, self._countable, events = survey.photons, survey.countable, survey.sample
        self.histogram, self.counts = survey.histogram, survey.counts.reshape(recording.rows, recording.cols)
        self.sensor, assumed = described(plain, options, events, self._first, guess_irf)
        last = self._first + self._bins - 1
        left_out = outside_note(outside, round(self.photons + outside), self._first, last)
        self.notes = recording.notes + assumed + left_out
        sampled = np.arange(plain.pixels).reshape(plain.rows, plain.cols) % survey.step == 0
        sample_sensor = self.sensor if survey.step == 1 else self.sensor.replace(mask=sampled)
        self.sample = Photons(sample_sensor, events, None, self.name, self.notes)
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
        sketcher = sums = photons = None
        for chunk in self._chunks():
            if isinstance(chunk, Rows):
                counts = self._all_bins(chunk.counts)
                if sketcher is None or sketcher.sensor.rows != len(counts):     # its tables serve all but the last
                    sketcher = self._strip_sketcher(len(counts), frequencies, gate)
                sketcher.reset()
                sketcher.add(PhotonHistograms(counts))
                strip = sketcher.sketch()
                if sums is None:
                    sums, photons = (np.zeros((self.sensor.rows, *part.shape[1:]), part.dtype)
                                     for part in (strip.sums, strip.photons))
                rows = np.s_[chunk.first_row:chunk.first_row + len(strip.sums)]
                sums[rows], photons[rows] = strip.sums, strip.photons
            else:
                sketcher = sketcher or Sketcher(self.sensor, frequencies, gate=gate)
                sketcher.add(self._inside(chunk))
        return sketcher.sketch() if sums is None else Sketch(tuple(frequencies), sums, photons)

    def read_whole(self) -> Photons:
        """All photons in memory; InvalidInput if they are more than MAX_PHOTONS, or fractional counts."""
        if self.whole is not None:
            return self.whole
        require(self._countable, f"{self.name} counts", "negative or fractional in places",
                "whole photons: only methods on sketches take others")
        require(self.photons <= MAX_PHOTONS, f"{self.name} photons", round(self.photons), f"at most {MAX_PHOTONS} in "
                "memory; `srt3d reconstruct` reads any number, by a method on sketches")
        parts = [self._inside(chunk) for chunk in self._chunks()]
        events = PhotonEvents(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("pixel", "toa")))
        return Photons(self.sensor, events, None, self.name, self.notes)

    def _chunks(self) -> Iterator[Events | Rows]:
        """The file from its beginning; a progress bar on a terminal if it takes long."""
        from tqdm import tqdm  # here: it takes a tenth of `import srt3d_ros`

        with tqdm(desc=f"reading {self.name}", total=100, delay=DELAY_S, disable=None, leave=False,
                  bar_format="{desc}: {percentage:3.0f} %|{bar}| {remaining}") as bar:
            for chunk in self._recording.chunks():
                bar.update(100 * chunk.done - bar.n)
                yield chunk

    def _num_bins(self, options: dict) -> int:
        """T: given or the recording's."""
        bins = int(number("num_bins", options.get("num_bins", self._recording.num_bins), "a number of bins"))
        require(2 <= bins <= MAX_BINS, "num_bins", bins, f"2 to {MAX_BINS} bins: give num_bins, gate or bin_width_s")
        return bins

    def _survey(self) -> tuple[Survey, int]:
        """Read the file once; the number of photons outside the gate, too."""
        survey, outside = Survey(self._recording.rows * self._recording.cols, self._bins), 0
        for chunk in self._chunks():
            before = survey.photons
            if isinstance(chunk, Rows):
                counts, found = self._gated(chunk.counts), chunk.counts.sum(dtype=np.float64)
                survey.add_histograms(counts.reshape(-1, counts.shape[2]), chunk.first_row * counts.shape[1])
            else:
                found = np.count_nonzero(chunk.pixel >= 0)
                survey.add_events(self._inside(chunk))
            outside += round(found - (survey.photons - before))
        return survey, outside

    def _inside(self, chunk: Events | Rows) -> PhotonEvents:
        """The photons of a chunk that are in a pixel and inside the gate."""
        if isinstance(chunk, Rows):
            counts = self._gated(chunk.counts)
            return events_of(counts.reshape(-1, counts.shape[2]), chunk.first_row * counts.shape[1])
        kept = (chunk.pixel >= 0) & (chunk.toa >= self._first) & (chunk.toa < self._first + self._bins)
        return PhotonEvents(chunk.pixel[kept].astype(np.uint32), (chunk.toa[kept] - self._first).astype(np.uint16))

    def _gated(self, counts: np.ndarray) -> np.ndarray:
        return counts[..., self._first:self._first + self._bins]

    def _all_bins(self, counts: np.ndarray) -> np.ndarray:
        """Histograms of T bins: fewer are the first ones."""
        counts = _in_a_known_type(self._gated(counts))
        missing = self._bins - counts.shape[2]
        counts = np.pad(counts, ((0, 0), (0, 0), (0, missing))) if missing else counts
        return np.ascontiguousarray(counts)

    def _strip_sketcher(self, rows: int, frequencies, gate: Gate | None) -> Sketcher:
        """Sketches histograms of so many rows."""
        strip = SensorModel(rows, self.sensor.cols, self._bins, self.sensor.bin_width_s, np.ones(1),
                            toa_reference=self.sensor.toa_reference)
        return Sketcher(strip, frequencies, gate=None if gate is None else Gate(strip, gate.first, gate.last))


def _in_a_known_type(counts: np.ndarray) -> np.ndarray:
    """Counts in a type that histograms may have."""
    if counts.dtype in (np.uint8, np.uint16, np.int32, np.float32):
        return counts.astype(counts.dtype.newbyteorder("="), copy=False)
    return counts.astype(np.int32 if counts.dtype.kind in "bi" and counts.dtype.itemsize < 4 else np.float32)
