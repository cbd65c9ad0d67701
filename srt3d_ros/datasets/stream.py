"""Laboratory files of any size: a `Recording` gives photons chunk by chunk, a `PhotonStream` knows their sensor too."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from srt3d_ros.core.gate import Gate
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import MAX_BINS, SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.sketch_design import SketchDesign, design_for
from srt3d_ros.core.sketching import Sketcher
from srt3d_ros.datasets import irf as irfs
from srt3d_ros.datasets.photons import MAX_PHOTONS, Photons, apply_options, number, outside_note
from srt3d_ros.errors import InvalidInput, require

MAX_KEPT = 2**24            # photons kept of the first pass: 100 MB. Files with fewer are read once and kept whole
BAR_DELAY_S = 2.0           # a progress bar appears after this long


class Chunk(NamedTuple):
    """Some photons of a recording in bins from 0, and the part of the file that has been read up to their end, 0 … 1.

    Attributes:
        pixel, toa: integers [N]; those outside the pixels (-1) or before bin 0 are left out by the stream.
    """

    pixel: np.ndarray
    toa: np.ndarray
    done: float


@dataclass(frozen=True, eq=False)
class Recording:
    """What a reader finds in a file.

    Args:
        rows, cols, num_bins: size of the frame. num_bins: of a laser period, or of all that the file can hold.
        bin_width_s: seconds.
        chunks: begins to read the file anew, in bounded memory, as often as it is called.
        name: the file's name without its suffix.
        notes: one line each for what was assumed.
        given: options that the file itself gives: irf, fov_deg, … as for `photons.gather_options`.
        reference_depth_bins: as for Photons.
    """

    rows: int
    cols: int
    num_bins: int
    bin_width_s: float
    chunks: Callable[[], Iterator[Chunk]]
    name: str
    notes: tuple[str, ...] = ()
    given: dict | None = None
    reference_depth_bins: np.ndarray | None = None


class PhotonStream:
    """The photons of a recording and their sensor. Opening it reads the file once, in bounded memory.

    Args:
        recording: of a reader.
        options: as from `photons.gather_options`; they win over what the file says.
        guess_irf: take an IRF of one bin where none can be estimated, and say so, instead of refusing.

    Attributes:
        sensor: SensorModel.
        notes: one line each for what was assumed, estimated or left out.
        photons: number of photons inside pixels and gate.
        sample: PhotonEvents, all photons of the pixels that `sample_sensor` does not mask: of all, if they are few.
        whole: Photons if the file has at most MAX_KEPT, else None.

    Raises:
        InvalidInput: naming the option or the part of the file that cannot be used.
    """

    def __init__(self, recording: Recording, options: dict, guess_irf: bool = False):
        self._recording, self.name = recording, recording.name
        options = (recording.given or {}) | options
        self._first, self._bins = options.get("gate", (0, self._num_bins(options)))
        step = self._survey()
        irf, notes = options.get("irf"), list(recording.notes)
        if irf is None:
            irf, note = self._estimated_irf(guess_irf)
            notes.append(note)
        if "fov_deg" not in options:
            notes.append("field of view taken to be 30° across the larger side: the file has none (--fov-deg)")
        plain = SensorModel(recording.rows, recording.cols, self._bins, recording.bin_width_s, irf)
        plain = apply_options(plain, {name: value for name, value in options.items() if name not in ("num_bins", "irf")})
        self.sensor = plain.replace(toa_offset_bins=plain.toa_offset_bins + self._first)
        self.notes = (*notes, *outside_note(self.outside, self.photons + self.outside, self._first,
                                            self._first + self._bins - 1))
        sampled = np.arange(plain.pixels).reshape(plain.rows, plain.cols) % step == 0
        self.sample_sensor = self.sensor if step == 1 else self.sensor.replace(mask=sampled)
        self.whole = None if step > 1 else Photons(self.sensor, self.sample, recording.reference_depth_bins, self.name,
                                                   self.notes)

    def __iter__(self) -> Iterator[PhotonEvents]:
        """The photons inside pixels and gate, chunk by chunk; a progress bar on a terminal if it takes long."""
        with tqdm(desc=f"reading {self.name}", total=100, delay=BAR_DELAY_S, disable=None, leave=False,
                  bar_format="{desc}: {percentage:3.0f} %|{bar}| {remaining}") as bar:
            for chunk in self._recording.chunks():
                bar.update(100 * chunk.done - bar.n)
                yield self._inside(chunk)

    def design(self, gate: str, frequencies: str, sketch_size: int | None) -> SketchDesign:
        """Gate and frequencies for the light of the sample."""
        return design_for(self.sample, self.sample_sensor, gate, frequencies, sketch_size)

    def sketch(self, frequencies, gate: Gate | None = None) -> Sketch:
        """The sketch of all photons; reads the file a second time unless it is kept whole."""
        sketcher = Sketcher(self.sensor, frequencies, gate=gate)
        for events in (self.sample,) if self.whole else self:
            sketcher.add(events)
        return sketcher.sketch()

    def read_whole(self) -> Photons:
        """All photons in memory; InvalidInput if they are more than MAX_PHOTONS."""
        if self.whole is not None:
            return self.whole
        require(self.photons <= MAX_PHOTONS, f"{self.name} photons", self.photons,
                f"at most {MAX_PHOTONS} in memory; `srt3d reconstruct` with a method on sketches reads any number")
        parts = list(self)
        events = PhotonEvents(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("pixel", "toa")))
        return Photons(self.sensor, events, self._recording.reference_depth_bins, self.name, self.notes)

    def _num_bins(self, options: dict) -> int:
        """T: given or the recording's."""
        bins = int(number("num_bins", options.get("num_bins", self._recording.num_bins), "a number of bins"))
        require(2 <= bins <= MAX_BINS, "num_bins", bins, f"2 to {MAX_BINS} bins: give --num-bins, --gate FIRST:LAST or "
                "a wider --bin-width-s")
        return bins

    def _survey(self) -> int:
        """Read the file once: count photons, keep a sample. Returns the step from one sampled pixel to the next."""
        self.photons, self.outside, step, kept, parts = 0, 0, 1, 0, []
        for events in self:
            self.photons += events.photons
            parts.append(_every(events, step))
            kept += parts[-1].photons
            while kept > MAX_KEPT and step < self._recording.rows * self._recording.cols:
                step *= 2
                parts = [_every(part, step) for part in parts]
                kept = sum(part.photons for part in parts)
        pixel = np.concatenate([part.pixel for part in parts] or [np.zeros(0, np.uint32)])
        toa = np.concatenate([part.toa for part in parts] or [np.zeros(0, np.uint16)])
        self.sample = PhotonEvents(pixel, toa)
        return step

    def _inside(self, chunk: Chunk) -> PhotonEvents:
        """The photons of a chunk that are in a pixel and inside the gate."""
        hit = chunk.pixel >= 0
        kept = hit & (chunk.toa >= self._first) & (chunk.toa < self._first + self._bins)
        self.outside += int(np.count_nonzero(hit) - np.count_nonzero(kept))
        return PhotonEvents(chunk.pixel[kept].astype(np.uint32), (chunk.toa[kept] - self._first).astype(np.uint16))

    def _estimated_irf(self, guess: bool) -> tuple[np.ndarray, str]:
        try:
            return irfs.estimate(self.sample, self._bins), \
                "IRF estimated from the photons, which makes it slightly broad: the file has none (--irf)"
        except InvalidInput:
            if not guess:
                raise
            return np.ones(1), "IRF taken to be one bin: the file has none, and none can be seen in its photons (--irf)"


def _every(events: PhotonEvents, step: int) -> PhotonEvents:
    """The photons of every step-th pixel, a power of two."""
    if step == 1:
        return events
    kept = events.pixel & np.uint32(step - 1) == 0
    return PhotonEvents(events.pixel[kept], events.toa[kept])
