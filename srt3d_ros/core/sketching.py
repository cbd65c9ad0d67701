"""Photons → sketch: the sums Σ_p exp(i ω_l x_p) of every pixel (SRT3D, ICASSP 2022, eq. 3).

exp(i ω_l x) takes only T values for integer ToA, so a T × 2m table replaces every sine and cosine, and sketching is
one table row added per photon. Photons sorted by pixel go through torch's embedding_bag, which does just that.
"""

import numpy as np
import torch

from srt3d_ros.core.frequencies import angular_frequencies
from srt3d_ros.core.photons import PhotonEvents, PhotonFrame, PhotonGates
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch, check_frequencies
from srt3d_ros.errors import require

CHUNK = 2**20       # photons converted at once: 4 MB, so that they stay in the cache and memory does not grow


class Sketcher:
    """Adds photons to the sketch of a frame, in any split and any order.

    The memory is that of the sketch and the table, whatever the number of photons.

    Args:
        sensor: pixels, T and gate words.
        frequencies: the integers k_l.
    """

    def __init__(self, sensor: SensorModel, frequencies):
        self.sensor = sensor
        self.frequencies = check_frequencies(frequencies, sensor.num_bins)
        self.table = torch.from_numpy(phase_table(self.frequencies, sensor.num_bins))
        self.reset()

    def reset(self) -> None:
        """Forget all photons."""
        shape = (self.sensor.pixels, self.table.shape[1])
        self._sums = np.zeros(shape, np.float64)     # float64: a window may add billions of unit vectors
        self._photons = np.zeros(self.sensor.pixels, np.int64)
        self._stamp_ns: int | None = None

    def add(self, frame: PhotonFrame) -> None:
        """Add the photons of a frame or packet.

        Raises:
            InvalidInput: if a photon lies outside the sensor's pixels or bins; nothing is added then.
        """
        if isinstance(frame, PhotonGates):
            sums, photons = self._sketch_gates(frame)
        else:
            frame.check(self.sensor)
            sums, photons = self._sketch_events(frame)
        self._sums += sums
        self._photons += photons
        self._stamp_ns = frame.stamp_ns if self._stamp_ns is None else min(self._stamp_ns, frame.stamp_ns)

    def sketch(self) -> Sketch:
        """The sketch of all photons added since the last reset."""
        rows, cols, m = self.sensor.rows, self.sensor.cols, len(self.frequencies)
        sums = self._sums.astype(np.float32).view(np.complex64).reshape(rows, cols, m)
        return Sketch(self.frequencies, sums, self._photons.astype(np.uint32).reshape(rows, cols), self._stamp_ns or 0)

    def _sketch_events(self, events: PhotonEvents) -> tuple[np.ndarray, np.ndarray]:
        pixels = self.sensor.pixels
        if events.toa.dtype.kind == "f":
            from srt3d_ros.kernels import cpu
            return cpu.sketch_continuous(events.pixel, events.toa, self._omegas(), pixels)
        if not events.is_sorted:
            from srt3d_ros.kernels import cpu
            return cpu.sketch_unsorted(events.pixel, events.toa, self.table.numpy(), pixels)
        starts = np.searchsorted(events.pixel, np.arange(pixels + 1, dtype=np.uint32))
        sums = torch.empty(pixels, self.table.shape[1])
        first = 0
        while first < pixels:                    # whole pixels, as many as fit into a chunk, but at least one
            fit = int(np.searchsorted(starts, starts[first] + CHUNK, side="right")) - 1
            last = min(max(fit, first + 1), pixels)
            toa = _as_signed(events.toa[starts[first]:starts[last]], self.sensor.num_bins)
            bins = torch.from_numpy(toa).to(torch.int32)
            offsets = torch.from_numpy((starts[first:last] - starts[first]).astype(np.int32))
            sums[first:last] = torch.nn.functional.embedding_bag(bins, self.table, offsets, mode="sum")
            first = last
        return sums.numpy(), np.diff(starts)

    def _sketch_gates(self, gates: PhotonGates) -> tuple[np.ndarray, np.ndarray]:
        words, form = gates.words, self.sensor.gates
        shape = (self.sensor.rows, self.sensor.cols)
        require(words.shape[1:] == shape, "gates shape", words.shape, f"[cycles, rows, cols] with {shape}")
        require(form is not None, "sensor.gates", "missing", "first_word and no_detection, to read gates")
        from srt3d_ros.kernels import cpu
        sums, photons, stray = cpu.sketch_gates(words.reshape(len(words), -1), self.table.numpy(),
                                                form.first_word, form.no_detection)
        last = form.first_word + self.sensor.num_bins - 1
        require(stray < 0, "gates word", stray, f"{form.first_word} … {last}, or {form.no_detection} for no photon")
        return sums, photons

    def _omegas(self) -> np.ndarray:
        return angular_frequencies(self.frequencies, self.sensor.num_bins)


def _as_signed(toa: np.ndarray, num_bins: int) -> np.ndarray:
    """Bins below T as signed integers, which torch converts many times faster than unsigned ones.

    A view if they fit and torch, which knows no read-only memory, can have it; else a copy.
    """
    signed = np.dtype(f"i{toa.itemsize}")
    fits = num_bins - 1 <= np.iinfo(signed).max and toa.flags.writeable
    return toa.view(signed) if fits else toa.astype(np.int32)


def phase_table(frequencies, num_bins: int) -> np.ndarray:
    """exp(i ω_l b) for every bin b, re and im interleaved; float32 [T, 2m]."""
    # k·b is reduced modulo T in integers, so that the phase is exact for large k·b.
    turns = np.outer(np.arange(num_bins), np.asarray(frequencies)) % num_bins / num_bins
    return np.exp(2j * np.pi * turns).astype(np.complex64).view(np.float32)


def sketch_photons(frame: PhotonFrame, sensor: SensorModel, frequencies) -> Sketch:
    """The sketch of one frame."""
    sketcher = Sketcher(sensor, frequencies)
    sketcher.add(frame)
    return sketcher.sketch()
