"""Photons: one frame of any file, bag, log or array with its sensor, to save, to sketch and to reconstruct."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self, Unpack

import numpy as np

from srt3d_ros.cloud import Cloud, as_noun, notes_text
from srt3d_ros.core.keys import written_out
from srt3d_ros.core.methods import DEFAULT_METHOD, MethodOptions, find
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.design import SketchOptions, design_sketch
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.gate import OFF
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonHistograms
from srt3d_ros.datasets import arrays, photon_file
from srt3d_ros.datasets.options import SensorOptions, gathered
from srt3d_ros.datasets.reading import IN_MEMORY, Reading, Said
from srt3d_ros.datasets.values import outside_note
from srt3d_ros.errors import quoted, require
from srt3d_ros.progress import compiling
from srt3d_ros.reconstruction import Reconstructor
from srt3d_ros.sketch import Sketch


@dataclass(frozen=True, eq=False, repr=False)
class Photons(Reading):
    """One frame of photons. A large array of counts stays in its file until it is sketched.

    Args:
        sensor: of the photons.
        frame: the photons, as events or as histograms, inside the sensor's pixels and bins.
        reference_depth_bins: float32 [S, rows, cols], reference depths of S surfaces in the sensor's bins (see
            SensorModel), NaN = unknown or no surface; None if the file has none.
        name: the file's name without its suffix.
        notes: a line for each assumption, estimate or omission. Show them to the user.
    """

    frame: PhotonEvents | PhotonHistograms

    @classmethod
    @written_out()
    def from_events(cls, row: Any, col: Any, toa: Any, *, sensor: SensorModel | None = None, stamp_ns: int = 0,
                    **options: Unpack[SensorOptions]) -> Self:
        """Photons from one entry of row, col and toa each, in any order.

        Arrays and lists of any integer or float type, of NumPy or torch; tensors are copied from their device.

        Args:
            row, col: [N], the pixel of each photon.
            toa: [N], time of arrival in bins, 0 ≤ toa < T; others, NaN too, are dropped and counted in a note.
                Integers are whole bins, floats positions: see Sensor.
            sensor: describes the sensor; options override it.
            stamp_ns: start of acquisition, nanoseconds.
            options: shape=(rows, cols), num_bins, bin_width_s, irf or irf_sigma_bins, fov_deg or projection, and the
                other arguments of Sensor. Without irf it is estimated from the photons, without fov_deg and projection
                a pinhole of 30° is assumed, without bin_width_s x, y and z count bins; notes say so.

        Raises:
            InvalidInput: naming the argument that is missing or cannot be used.
        """
        return cls._in_memory(arrays.from_photons((row, col, toa), gathered(options, sensor), Said(stamp_ns=stamp_ns)))

    @classmethod
    @written_out()
    def from_counts(cls, counts: Any, *, sensor: SensorModel | None = None, stamp_ns: int = 0,
                    **options: Unpack[SensorOptions]) -> Self:
        """Photons from counts in bins, whose array gives shape and num_bins.

        Args:
            counts: [rows, cols, bins], photons in each bin; negative where the sensor has subtracted ambient light.
            sensor, stamp_ns, options: as for `from_events`.

        Raises:
            InvalidInput: naming the argument that is missing or cannot be used.
        """
        said = Said(stamp_ns=stamp_ns)
        return cls._in_memory(arrays.from_counts(counts, gathered(options, sensor), said, in_file=False))

    @classmethod
    def _in_memory(cls, reading: Reading) -> Self:
        return cls(reading.sensor, reading.frame, None, IN_MEMORY, reading.notes)

    def __repr__(self) -> str:
        sensor = self.sensor
        return (f"Photons of {self.name}: {self.photons:,} in {sensor.rows} × {sensor.cols} pixels and "
                f"{sensor.num_bins} bins{notes_text(self.notes)}")

    @written_out(SketchOptions)
    def sketch(self, sketch_size: int | None = None, *, frequencies: str | Sequence[int] = "auto",
               gate: str | tuple[int, int] = OFF) -> Sketch:
        """The sketch: m complex numbers a pixel for any number of photons.

        Raises:
            InvalidInput: naming the argument that cannot be used.
        """
        require(sketch_size is None or isinstance(sketch_size, int | np.integer), "sketch_size", quoted(sketch_size),
                "an integer")
        with compiling():
            kept, chosen = design_sketch(self.sensor, gate, frequencies, sketch_size, self.frame)
            sketch = sketch_photons(self.frame, self.sensor, chosen, kept)
        outside = max(self.photons - int(sketch.photons.sum(dtype=np.int64)), 0)
        notes = outside_note(outside, self.photons, kept.first, kept.last) if kept else ()
        numbers, mean = 2 * len(chosen), self.photons / self.sensor.pixels
        if sketch_size is not None and numbers > mean:
            notes += (f"the sketch is longer than its photons: {numbers} numbers a pixel for {mean:.3g} photons",)
        return as_noun(Sketch, sketch, notes=self.notes + notes)

    @written_out(SketchOptions, MethodOptions)
    def reconstruct(self, *, sketch_size: int | None = None, frequencies: str | Sequence[int] | None = None,
                    gate: str | tuple[int, int] = OFF, **options: Unpack[MethodOptions]) -> Cloud:
        """The point cloud; methods that were published with other frequencies than auto take these by default.

        Raises:
            InvalidInput: naming the argument that cannot be used.
        """
        method = find(options.get("method", DEFAULT_METHOD))
        if method.needs == "sketch":
            started = time.perf_counter()
            used = method.frequencies if frequencies is None else frequencies
            sketch = self.sketch(sketch_size, frequencies=used, gate=gate)
            sketch_ms = round((time.perf_counter() - started) * 1e3, 3)
            return replace(sketch.reconstruct(**options), sketch_ms=sketch_ms)
        for name, value in (("sketch_size", sketch_size), ("frequencies", frequencies)):
            require(value is None, name, problem=f"{method.name} works on all times of arrival and takes no {name}.")
        kept = design_sketch(self.sensor, gate, "consecutive", frame=self.frame).gate
        photons = self if kept is None else self.gated(kept.first, kept.last)
        return Reconstructor(photons.sensor, **options)(photons)

    def save(self, path: str | Path) -> None:
        """Write an .npz photon file with the sensor, true depths and notes, which `srt3d_ros.read` reads again.

        Raises:
            InvalidInput: another suffix, a path that cannot be written, or an .npz file there that is none of photons.
        """
        photon_file.save(path, self.sensor, self.frame, self.reference_depth_bins, self.notes)
