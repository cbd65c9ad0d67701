"""FrameSketcher: photons in, sketches out: the sums Σ_p exp(i ω_l x_p) of every pixel (SRT3D, ICASSP 2022, eq. 3).

exp(i ω_l x) has only T values for integer ToA. A table of T rows of 2m numbers replaces all sines and cosines, and
each photon adds one row. The sums are integers (kernels/cpu/sketching/phase_sums.py), so a sketch depends on its
photons only, bit for bit: not on their order, their packets or the number of threads.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from srt3d_ros.core.sensor.bins import MAX_BINS, HistogramBins
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.gate import Gate
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonFrame, PhotonGates, PhotonHistograms
from srt3d_ros.core.sketching.sums import PhaseSums, check_frequencies
from srt3d_ros.kernels.devices import kernels_for

ROUNDING = 1e-5         # relative error of float32 sums
FAR = 4.0               # times a template's mean: the noise of higher bins would be reconstructed as a surface
STEPS = 16              # steps of a bin to which ToA with fractions are rounded


class FrameSketcher:
    """Adds the photons of a frame, in any split and any order, and gives its sketch.

    Args:
        sensor: pixels, T and gate words.
        frequencies: the integers k_l.
        gate: of this sensor. Photons outside are dropped; sketches are of `gate.sensor`.
    """

    def __init__(self, sensor: SensorModel, frequencies: Sequence[int], gate: Gate | None = None):
        self.sensor, self.gate = sensor, gate
        self.sketch_sensor = sensor if gate is None else gate.sensor        # of the sketches
        self.frequencies = check_frequencies(frequencies, self.sketch_sensor.num_bins)
        self._kernels = kernels_for("cpu")
        self._rows = self._kernels.fixed_rows(self.phase_table(np.arange(sensor.num_bins) + 0.5))
        self._sums = self._kernels.new_sums(sensor.pixels, self._rows)      # of the open frame
        self._subtracted = False            # counts may have been negative
        self.reset()

    def reset(self) -> None:
        """Forget the photons of the open frame."""
        self._sums[:] = 0
        self.stamps_ns: list[int] = []          # of its packets
        self._cycles = 0                        # its laser cycles, 0 if not known

    def add(self, frame: PhotonFrame) -> None:
        """Add the photons of a frame or packet that its `check` accepts: others would be written outside the sums."""
        if isinstance(frame, PhotonHistograms):
            counts, (table, of_template) = frame.counts, self.histogram_tables
            self._kernels.sketch_histograms(counts.reshape(-1, counts.shape[2]), table, of_template, self._sums)
            self._subtracted |= of_template is not None or frame.has_negative
        elif isinstance(frame, PhotonGates):
            form, words = self.sensor.gate_words, self._kernels.array(frame.words)
            self._kernels.sketch_gates(words.reshape(len(words), self.sensor.pixels), self._rows, form.first_word,
                                       form.no_detection, self._sums)
        elif len(frame.toa) > 0:
            self._add_events(frame)
        self.stamps_ns.append(frame.stamp_ns)
        self._cycles += len(frame.words) if isinstance(frame, PhotonGates) else self.sensor.cycles or 0

    def end_frame(self) -> PhaseSums:
        """End the open frame; its sketch."""
        shape, m = self.sensor.shape, len(self.frequencies)
        before, cycles, stamp_ns = None, self._cycles, min(self.stamps_ns, default=0)
        if cycles and self.gate is not None:
            units = self._sums[:, 2 * m + 1] * (self.sensor.dead_time.periods + 1)
            before = np.rint(units / self._kernels.UNIT).astype(np.uint32).reshape(shape)
        sums, photons = self._kernels.read_sums(self._sums, m)
        self.reset()
        if self._subtracted:        # subtraction can leave n < |sum|; raise n so that |z| ≤ 1
            longest = np.abs(sums).max(axis=1) * (1 - ROUNDING)
            photons, cycles = np.maximum(photons, np.ceil(longest).astype(np.uint32)), 0
        return PhaseSums(self.frequencies, sums.reshape(*shape, m), photons.reshape(shape), stamp_ns, cycles,
                         before, sensor=self.sketch_sensor)

    def phase_table(self, middles: np.ndarray) -> np.ndarray:
        """exp(i ω_l x) for bins of the sensor: real and imaginary parts in turn, then a column of 1 to count photons.

        All are 0 outside the gate. The last column is 1 before the gate: it counts laser cycles that ended there. After
        a dead time of q ≥ 1 periods, it has all photons outside the gate, and the cycles that each costs, over q + 1.

        Args:
            middles: of n bins, counted in bins of the sensor; of its own 0.5, 1.5, …

        Returns:
            float32 [n, 2m + 2].
        """
        start, num_bins = 0 if self.gate is None else self.gate.start, self.sketch_sensor.num_bins
        from_start = (middles - start) % self.sensor.num_bins
        # Count in half bins: k·x is then a whole number for the sensor's own bins, and the phase exact for large k·x.
        half_bins, period = 2 * from_start - 1, 2 * num_bins
        turns = np.outer(half_bins, (*self.frequencies, 0)) % period / period
        inside, dead = from_start < num_bins, self.sketch_sensor.dead_time
        phases = np.exp(2j * np.pi * turns) * inside[:, None]
        cost = dead.blinded((middles - start) % dead.period) / (dead.periods + 1) if dead.periods else middles < start
        phases[:, -1] += 1j * ~inside * cost
        return phases.astype(np.complex64).view(np.float32)

    def _add_events(self, events: PhotonEvents) -> None:
        toa, rows = events.toa, self._rows
        if toa.dtype.kind == "f":
            steps, rows = self._fine_rows
            toa = np.rint(toa * steps).astype(np.uint16)
        self._kernels.sketch_events(*map(self._kernels.array, (events.pixel, toa)), rows, events.is_sorted, self._sums)

    @cached_property
    def _fine_rows(self) -> tuple[np.float32, np.ndarray]:
        """For ToA with fractions: the steps s of a bin to which they are rounded, and a table row for each step.

        s is STEPS, or as many as 16 bits can count. Rounding adds 1/(12 s²) bins² to a photon's variance: 0.03 % for
        s = 16 and a pulse with a standard deviation of 1 bin. |z_l| falls by a share π² k_l² / (6 s² T²) at most.
        """
        steps = max(min(STEPS, (MAX_BINS - 1) // self.sensor.num_bins), 1)
        at = np.arange(steps * self.sensor.num_bins + 1) / steps
        return np.float32(steps), self._kernels.fixed_rows(self.phase_table(at + 0.5))

    @cached_property
    def histogram_tables(self) -> tuple[np.ndarray, np.ndarray | None]:
        """The phases of the bins of the sensor's histograms, and the phase sums of their template, or None.

        float32 [n, 2m + 2]; and [2m + 2], or [rows · cols, 2m + 2] if pixels have templates of their own. A bin in
        which the template is far above its mean counts as the mean of the other bins inside the gate: a uniform
        background still adds nothing.
        """
        bins = self.sensor.histograms or HistogramBins(self.sensor.num_bins)
        table = self.phase_table(bins.centers())
        if bins.template is None:
            return table, None
        of_pixel = bins.template.reshape(-1, bins.num_bins).mean(axis=0)
        left_out = (of_pixel > max(FAR * of_pixel.mean(), 1))[:, None]
        others = (table[:, -2:-1] > 0) & ~left_out
        mean = (table * left_out).sum(axis=0) / max(others.sum(), 1)
        table = ((table + mean) * others).astype(np.float32)
        return table, bins.template @ table


def sketch_photons(frame: PhotonFrame, sensor: SensorModel, frequencies: Sequence[int], gate: Gate | None = None
                   ) -> PhaseSums:
    """The sketch of one frame; InvalidInput if a photon is outside the sensor."""
    frame.check(sensor)
    sketcher = FrameSketcher(sensor, frequencies, gate=gate)
    sketcher.add(frame)
    return sketcher.end_frame()
