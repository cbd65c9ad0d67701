"""Photons → sketch: the sums Σ_p exp(i ω_l x_p) of every pixel (SRT3D, ICASSP 2022, eq. 3).

exp(i ω_l x) takes only T values for integer ToA, so a T × 2m table replaces every sine and cosine, and sketching is
one table row added per photon. The sums are integers (kernels/cpu/rows.py): what a sketch is depends on its photons
only, bit for bit, not on their order, their packets or the number of threads.
"""

from functools import cached_property

import numpy as np

from srt3d_ros.core.device import kernels_for
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.core.sketching.photons import PhotonEvents, PhotonFrame, PhotonGates, PhotonHistograms, word_wanted
from srt3d_ros.core.sketching.sketch import Sketch, check_frequencies
from srt3d_ros.errors import require

ROUNDING = 1e-5         # relative, of float32 sums
FAR = 4.0               # times its mean: where a template is higher, its noise would be taken for a surface


class Sketcher:
    """Adds photons to the sketch of a frame, in any split and any order; its memory is that of sketch and table.

    Args:
        sensor: pixels, T and gate words.
        frequencies: the integers k_l.
        gate: of this sensor. Photons outside are dropped: the sketch is one of `gate.sensor`.
    """

    def __init__(self, sensor: SensorModel, frequencies, gate: Gate | None = None):
        self.sensor, self.gate = sensor, gate
        self.frequencies = check_frequencies(frequencies, sensor.num_bins if gate is None else gate.num_bins)
        _, self._kernels = kernels_for("cpu")
        table = phase_table(self.frequencies, sensor.num_bins, sensor.first_bin_center) if gate is None else \
            gated_table(self.frequencies, gate)
        self._rows = self._kernels.fixed_rows(table)
        self._sums, self._photons = self._kernels.new_sums(sensor.pixels, table.shape[1])
        self._stamp_ns: int | None = None
        self._subtracted = False            # whether counts may have been negative

    @property
    def sketch_sensor(self) -> SensorModel:
        """What the sketches are of: the sensor, or its gate."""
        return self.sensor if self.gate is None else self.gate.sensor

    def reset(self) -> None:
        """Forget all photons."""
        self._sums[:] = 0
        self._photons[:] = 0
        self._stamp_ns = None

    def add(self, frame: PhotonFrame) -> None:
        """Add the photons of a frame or packet; InvalidInput, and none is added, if one is outside the sensor."""
        if isinstance(frame, PhotonHistograms):
            self._add_histograms(frame)
        elif isinstance(frame, PhotonGates):
            self._add_gates(frame)
        elif frame.photons > 0:
            self._add_events(frame)
        self._stamp_ns = frame.stamp_ns if self._stamp_ns is None else min(self._stamp_ns, frame.stamp_ns)

    def sketch(self) -> Sketch:
        """The sketch of all photons added since the last reset."""
        return self._sketch_of(self._sums, self._photons)

    def _sketch_of(self, sums: np.ndarray, photons: np.ndarray) -> Sketch:
        rows, cols, m = self.sensor.rows, self.sensor.cols, len(self.frequencies)
        if self.gate is not None:
            photons = self._kernels.counted(sums, 2 * m)
        if self._subtracted:
            photons = self._at_least_as_seen(sums, photons)
        sums, photons = self._kernels.read_sums(sums, photons, 2 * m)
        return Sketch(self.frequencies, sums.reshape(rows, cols, m), photons.reshape(rows, cols), self._stamp_ns or 0,
                      sensor=self.sketch_sensor)

    def _at_least_as_seen(self, sums: np.ndarray, photons: np.ndarray) -> np.ndarray:
        """Photon numbers of histograms from which something was subtracted: as many as the longest sum needs, |z| ≤ 1.

        Of what is subtracted the noise stays, and n, which is near 0 in a pixel without a surface, stands for it.
        """
        read, _ = self._kernels.read_sums(sums, photons.clip(1), 2 * len(self.frequencies))
        longest = np.abs(read).max(axis=1) * (1 - ROUNDING)
        return np.maximum(photons, np.ceil(longest).astype(np.int64))

    def _add_events(self, events: PhotonEvents) -> None:
        kernels, pixel, toa = self._kernels, _read_only(events.pixel), _read_only(events.toa)
        inside, ordered = kernels.inspect_events(pixel, toa, self.sensor.pixels, self.sensor.num_bins)
        if not inside:
            events.check(self.sensor)           # says which photon
        if events.toa.dtype.kind == "f":
            self._add_continuous(events, ordered)
        elif ordered:
            kernels.sketch_sorted(pixel, toa, self._rows, self._sums, self._photons)
        else:
            kernels.sketch_unsorted(pixel, toa, self._rows, self._sums, self._photons)

    def _add_continuous(self, events: PhotonEvents, ordered: bool) -> None:
        frequencies, num_bins = self.frequencies, self.sensor.num_bins
        if self.gate is not None:               # no table whose rows are zero outside; frequency 0 counts those inside
            events, frequencies, num_bins = self.gate.photons(events), (*frequencies, 0), self.gate.num_bins
        self._kernels.sketch_continuous(_read_only(events.pixel), _read_only(events.toa), frequencies, num_bins,
                                        ordered, self._sums, self._photons)

    def _add_gates(self, gates: PhotonGates) -> None:
        gates.check(self.sensor)
        form = self.sensor.gates
        words = _read_only(gates.words).reshape(len(gates.words), self.sensor.pixels)
        if words.size > 0:
            stray = self._kernels.find_stray(words, form.first_word, form.no_detection, self.sensor.num_bins)
            require(stray < 0, "gates word", stray, word_wanted(self.sensor))
            self._kernels.sketch_gates(words, self._rows, form.first_word, form.no_detection, self._sums, self._photons)

    def _add_histograms(self, histograms: PhotonHistograms) -> None:
        histograms.check(self.sensor)
        counts, (table, of_template) = histograms.counts, self._histogram_tables
        rows, cols, n = counts.shape
        here = slice((first := (histograms.first_row or 0) * cols), first + rows * cols)
        table, of_template = (values[here] if of_pixels else values for values, of_pixels in (
            (table, table.ndim == 3), (of_template, of_template is not None and of_template.ndim == 2)))
        self._kernels.sketch_histograms(counts.reshape(-1, n), table, of_template, self._sums[here],
                                        self._photons[here])
        self._subtracted |= counts.dtype.kind != "u" or of_template is not None

    @cached_property
    def _histogram_tables(self) -> tuple[np.ndarray, np.ndarray | None]:
        """The phases of the bins of histograms, and the phase sums of the template, or None."""
        table, bins = histogram_table(self.sensor, self.frequencies, self.gate), self.sensor.histograms
        of_template = None
        if bins is not None and bins.template is not None:
            of_pixel = bins.template.reshape(-1, bins.num_bins).mean(axis=0)
            table = without(table, of_pixel > max(FAR * of_pixel.mean(), 1))
            of_template = np.matmul(bins.template[..., None, :], table)[..., 0, :]
        return table, of_template


def _read_only(values: np.ndarray) -> np.ndarray:
    """A contiguous view that cannot be written; for arrays that can be, numba would compile the kernels once more."""
    view = np.ascontiguousarray(values).view()
    view.flags.writeable = False
    return view


def phase_table(frequencies, num_bins: int, first_bin_center: float = 0.0) -> np.ndarray:
    """exp(i ω_l x) for the centre x of every bin, re and im interleaved; float32 [T, 2m]."""
    # In half bins, so that k·x is reduced modulo T in integers and the phase is exact for large k·x.
    period = 2 * num_bins
    centers = 2 * np.arange(num_bins) + round(2 * first_bin_center)
    turns = np.outer(centers, np.asarray(frequencies)) % period / period
    return np.exp(2j * np.pi * turns).astype(np.complex64).view(np.float32)


def gated_table(frequencies, gate: Gate) -> np.ndarray:
    """The same for the bins of a gate's source: rows of zeros outside the gate, and inside 1 + 0i behind the others.

    That column counts the photons inside, and outside ones cost what the others do, without a branch. float32
    [T, 2m + 2].
    """
    table = np.zeros((gate.source.num_bins, 2 * len(frequencies) + 2), np.float32)
    inside = (gate.start + np.arange(gate.num_bins)) % gate.source.num_bins
    table[inside] = phase_table((*frequencies, 0), gate.num_bins, gate.sensor.first_bin_center)
    return table


def histogram_table(sensor: SensorModel, frequencies, gate: Gate | None = None) -> np.ndarray:
    """Phases of the bins of a sensor's histograms; float32 [n, 2m + 2], or [rows · cols, n, 2m + 2] if pixels differ.

    As `gated_table`: zeros outside the gate, and inside 1 + 0i behind the others.
    """
    bins = sensor.histograms
    edges = np.arange(sensor.num_bins) + 0.5 if bins is None else bins.centers()
    start, num_bins = (0, sensor.num_bins) if gate is None else (gate.start, gate.num_bins)
    from_start = (edges - start) % sensor.num_bins
    turns = (from_start + sensor.first_bin_center - 0.5)[..., None] * np.asarray((*frequencies, 0)) / num_bins
    phases = np.exp(2j * np.pi * turns) * (from_start < num_bins)[..., None]
    return phases.astype(np.complex64).view(np.float32)


def without(table: np.ndarray, left_out: np.ndarray) -> np.ndarray:
    """A table that takes bins of histograms to hold the mean of the others inside the gate, whatever they count.

    So a uniform background still adds nothing.
    """
    others = (table[..., -2:-1] > 0) & ~left_out[:, None]
    mean = (table * left_out[:, None]).sum(axis=-2, keepdims=True) / others.sum(axis=-2, keepdims=True).clip(1)
    return ((table + mean) * others).astype(np.float32)


def sketch_photons(frame: PhotonFrame, sensor: SensorModel, frequencies, gate: Gate | None = None) -> Sketch:
    """The sketch of one frame."""
    sketcher = Sketcher(sensor, frequencies, gate=gate)
    sketcher.add(frame)
    return sketcher.sketch()
