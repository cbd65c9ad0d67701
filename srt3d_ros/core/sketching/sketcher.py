"""Photons → sketch: the sums Σ_p exp(i ω_l x_p) of every pixel (SRT3D, ICASSP 2022, eq. 3), also of a sliding window.

exp(i ω_l x) takes only T values for integer ToA, so a T × 2m table replaces every sine and cosine, and sketching is
one table row added per photon. The sums are integers (kernels/cpu/rows.py): what a sketch is depends on its photons
only, bit for bit, not on their order, their packets or the number of threads.
"""

from collections import deque
from functools import cached_property

import numpy as np

from srt3d_ros.core.device import kernels_for
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.core.sketching.photons import PhotonEvents, PhotonFrame, PhotonGates, PhotonHistograms, word_wanted
from srt3d_ros.core.sketching.sketch import Sketch, check_frequencies
from srt3d_ros.errors import require

MAX_WINDOW_BYTES = 2**31
ROUNDING = 1e-5         # relative, of float32 sums
FAR = 4.0               # times its mean: where a template is higher, its noise would be taken for a surface
Sums = tuple[np.ndarray, np.ndarray]


class Sketcher:
    """Adds the photons of frames, in any split and any order, and gives the sketch of the newest W frames.

    Photons add up without end; a window is what has been added since its first frame began. The sums are integers that
    wrap around, so the difference is exact, however long this runs, and costs what one frame does, whatever W. Memory:
    a table, and one set of sums a frame of the window.

    Args:
        sensor: pixels, T and gate words.
        frequencies: the integers k_l.
        window_frames: W, 1 or more.
        gate: of this sensor. Photons outside are dropped: the sketch is one of `gate.sensor`.

    Raises:
        InvalidInput: also if the window would take more than MAX_WINDOW_BYTES.
    """

    def __init__(self, sensor: SensorModel, frequencies, window_frames: int = 1, gate: Gate | None = None):
        self.sensor, self.gate = sensor, gate
        self.frequencies = check_frequencies(frequencies, sensor.num_bins if gate is None else gate.num_bins)
        _, self._kernels = kernels_for("cpu")
        table = phase_table(sensor, self.frequencies, gate)
        table = table[:, :-2] if gate is None else table
        self._rows = self._kernels.fixed_rows(table)
        self._sums, self._photons = self._kernels.new_sums(sensor.pixels, table.shape[1])
        self._subtracted = False            # whether counts may have been negative
        bytes_each = self._sums.nbytes + self._photons.nbytes
        most = max(MAX_WINDOW_BYTES // bytes_each, 1)
        require(1 <= window_frames <= most, "window_frames", window_frames, f"1 to {most} for {sensor.rows} × "
                f"{sensor.cols} pixels, which take {bytes_each / 1e6:.3g} MB a frame")
        self.window_frames = window_frames
        self.reset()

    @property
    def sketch_sensor(self) -> SensorModel:
        """What the sketches are of: the sensor, or its gate."""
        return self.sensor if self.gate is None else self.gate.sensor

    def reset(self) -> None:
        """Forget all photons, of the open frame and of all before."""
        self._sums[:] = 0
        self._photons[:] = 0
        self._stamp_ns: int | None = None       # of the open frame
        # Of the window's frames, the open one last: what had been added before each (None: nothing), its first stamp.
        self._before: deque[Sums | None] = deque([None], maxlen=self.window_frames)
        self._stamps_ns: deque[int] = deque(maxlen=self.window_frames)

    def add(self, frame: PhotonFrame) -> None:
        """Add the photons of a frame or packet; InvalidInput, and none is added, if one is outside the sensor."""
        if isinstance(frame, PhotonHistograms):
            self._add_histograms(frame)
        elif isinstance(frame, PhotonGates):
            self._add_gates(frame)
        elif frame.photons > 0:
            self._add_events(frame)
        self._stamp_ns = frame.stamp_ns if self._stamp_ns is None else min(self._stamp_ns, frame.stamp_ns)

    @property
    def kept(self) -> int:
        """Photons of the open frame that are inside the gate, which there has to be: more than all of them if there are
        negative counts outside."""
        column = slice(2 * len(self.frequencies), 2 * len(self.frequencies) + 1)
        here, before = self._sums[:, column], self._before[-1]
        if before is not None:
            here = here - before[0][:, column]
        return int(self._kernels.counted(here, 0).sum())

    def end_frame(self) -> Sketch:
        """End the open frame; the sketch of the window of which it is the last, and its stamp."""
        self._stamps_ns.append(self._stamp_ns or 0)
        now, oldest = (self._sums, self._photons), self._before[0]
        if oldest is not None:                  # of a full window: not needed after this, so it takes the difference
            for whole, part in zip(now, oldest, strict=True):
                np.subtract(whole, part, out=part)
        sketch = self._sketch_of(*(oldest or now), max(self._stamps_ns))
        if self.window_frames == 1:             # cheaper than keeping what was added before
            self.reset()
            return sketch
        self._stamp_ns = None
        before = oldest or (np.empty_like(self._sums), np.empty_like(self._photons))
        for part, whole in zip(before, now, strict=True):
            part[:] = whole
        self._before.append(before)
        return sketch

    def sketch(self) -> Sketch:
        """The sketch of all photons added since the last reset."""
        return self._sketch_of(self._sums, self._photons, self._stamp_ns or 0)

    def _sketch_of(self, sums: np.ndarray, photons: np.ndarray, stamp_ns: int) -> Sketch:
        rows, cols, m = self.sensor.rows, self.sensor.cols, len(self.frequencies)
        if self.gate is not None:
            photons = self._kernels.counted(sums, 2 * m)
        if self._subtracted:
            photons = self._at_least_as_seen(sums, photons)
        sums, photons = self._kernels.read_sums(sums, photons, 2 * m)
        return Sketch(self.frequencies, sums.reshape(rows, cols, m), photons.reshape(rows, cols), stamp_ns,
                      sensor=self.sketch_sensor)

    def _at_least_as_seen(self, sums: np.ndarray, photons: np.ndarray) -> np.ndarray:
        """Photon numbers of histograms from which something was subtracted: as many as the longest sum needs, |z| ≤ 1.

        Of what is subtracted the noise stays, and n, which is near 0 in a pixel without a surface, stands for it.
        """
        read, _ = self._kernels.read_sums(sums, photons.clip(1), 2 * len(self.frequencies))
        longest = np.abs(read).max(axis=1) * (1 - ROUNDING)
        return np.maximum(photons, np.ceil(longest).astype(np.int64))

    # ---- Forms of photons

    def _add_events(self, events: PhotonEvents) -> None:
        events.check(self.sensor)
        if events.toa.dtype.kind == "f":
            self._add_continuous(events)
        else:
            self._kernels.sketch_events(_read_only(events.pixel), _read_only(events.toa), self._rows, events.is_sorted,
                                        self._sums, self._photons)

    def _add_continuous(self, events: PhotonEvents) -> None:
        frequencies, num_bins = self.frequencies, self.sensor.num_bins
        if self.gate is not None:               # no table whose rows are zero outside; frequency 0 counts those inside
            events, frequencies, num_bins = self.gate.photons(events), (*frequencies, 0), self.gate.num_bins
        self._kernels.sketch_continuous(_read_only(events.pixel), _read_only(events.toa), frequencies, num_bins,
                                        events.is_sorted, self._sums, self._photons)

    def _add_gates(self, gates: PhotonGates) -> None:
        gates.check(self.sensor)
        form = self.sensor.gates
        words = _read_only(gates.words).reshape(len(gates.words), self.sensor.pixels)
        if words.size > 0:
            stray = self._kernels.find_stray(words.reshape(-1), form.first_word, form.no_detection,
                                             self.sensor.num_bins)
            require(stray < 0, "gates word", stray, word_wanted(self.sensor))
            self._kernels.sketch_gates(words, self._rows, form.first_word, form.no_detection, self._sums, self._photons)

    def _add_histograms(self, histograms: PhotonHistograms) -> None:
        histograms.check(self.sensor)
        counts, (table, of_template) = histograms.counts, self._histogram_tables
        self._kernels.sketch_histograms(counts.reshape(-1, counts.shape[2]), table, of_template, self._sums,
                                        self._photons)
        self._subtracted |= counts.dtype.kind != "u" or of_template is not None

    @cached_property
    def _histogram_tables(self) -> tuple[np.ndarray, np.ndarray | None]:
        return histogram_tables(self.sensor, self.frequencies, self.gate)


def _read_only(values: np.ndarray) -> np.ndarray:
    """A contiguous view that cannot be written; for arrays that can be, numba would compile the kernels once more."""
    view = np.ascontiguousarray(values).view()
    view.flags.writeable = False
    return view


def sketch_photons(frame: PhotonFrame, sensor: SensorModel, frequencies, gate: Gate | None = None) -> Sketch:
    """The sketch of one frame."""
    sketcher = Sketcher(sensor, frequencies, gate=gate)
    sketcher.add(frame)
    return sketcher.sketch()


def phase_table(sensor: SensorModel, frequencies, gate: Gate | None, middles: np.ndarray | None = None) -> np.ndarray:
    """exp(i ω_l x) for bins of a sensor, re and im interleaved, then 1, which counts, and 0; 0 outside the gate.

    Args:
        middles: of the bins, counted in the sensor's own; unless given, those of the sensor's own, 0.5, 1.5, …

    Returns:
        float32 [n, 2m + 2].
    """
    middles = np.arange(sensor.num_bins) + 0.5 if middles is None else middles
    start, num_bins = (0, sensor.num_bins) if gate is None else (gate.start, gate.num_bins)
    from_start = (middles - start) % sensor.num_bins
    # In half bins, so that k·x of the sensor's own is a whole number and the phase is exact for large k·x.
    half_bins, period = 2 * from_start - 1, 2 * num_bins
    turns = np.outer(half_bins, (*frequencies, 0)) % period / period
    phases = np.exp(2j * np.pi * turns) * (from_start < num_bins)[:, None]
    return phases.astype(np.complex64).view(np.float32)


def histogram_tables(sensor: SensorModel, frequencies, gate: Gate | None) -> tuple[np.ndarray, np.ndarray | None]:
    """The phases of the bins of a sensor's histograms, and the phase sums of their template, or None.

    Bins in which the template is far above its mean are taken to hold the mean of the others inside the gate, whatever
    they count: a uniform background still adds nothing.

    Returns:
        float32 [n, 2m + 2]; and [2m + 2], or [rows · cols, 2m + 2] if pixels have templates of their own.
    """
    bins = sensor.histograms
    table = phase_table(sensor, frequencies, gate, None if bins is None else bins.centers())
    if bins is None or bins.template is None:
        return table, None
    of_pixel = bins.template.reshape(-1, bins.num_bins).mean(axis=0)
    left_out = (of_pixel > max(FAR * of_pixel.mean(), 1))[:, None]
    others = (table[:, -2:-1] > 0) & ~left_out
    mean = (table * left_out).sum(axis=0) / max(others.sum(), 1)
    table = ((table + mean) * others).astype(np.float32)
    return table, bins.template @ table
