"""The library in Python: arrays of photons, photon files and sketches to point clouds. `import srt3d_ros` shows it."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from srt3d_ros.core import sketch as core_sketch
from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.gate import OFF
from srt3d_ros.core.methods import DEFAULT_METHOD, SKETCH_METHODS, find
from srt3d_ros.core.photons import PhotonEvents, PhotonGates, PhotonHistograms
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch_design import SketchDesign, design_for
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.datasets import Photons, arrays, open_photons, sketch_file
from srt3d_ros.datasets.arrays import SensorOptions
from srt3d_ros.datasets.photons import outside_note
from srt3d_ros.errors import InvalidInput, require

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from PIL.Image import Image

__all__ = ["Cloud", "InvalidInput", "Photons", "Sensor", "Sketch", "open", "photons", "reconstruct", "sketch"]

Sensor = SensorModel


@dataclass(frozen=True, eq=False, repr=False)
class Cloud(PointCloud):
    """The points of one frame, a PointCloud, with their sensor and how they were made.

    Args:
        sensor: places the points: that of the photons, with finer pixels if `upsampling` says so, behind a gate if
            there is one.
        facts: what `srt3d reconstruct --json` prints: method, device, photons, frequencies, times in ms, ….
        notes: one line each for what was assumed, estimated or left out.
    """

    sensor: SensorModel = field(kw_only=True)
    facts: dict[str, Any] = field(kw_only=True, default_factory=dict)
    notes: tuple[str, ...] = field(kw_only=True, default=())

    def __repr__(self) -> str:
        ranges = np.percentile(np.linalg.norm(self.xyz, axis=1), (0, 100)) if len(self) else (np.nan, np.nan)
        text = (f"Cloud of {len(self):,} points at {ranges[0]:.4g} to {ranges[1]:.4g} m, from "
                f"{self.facts.get('photons', 0):,} photons of {self.sensor.rows} × {self.sensor.cols} pixels")
        return "\n".join([text, *self.notes])

    def save(self, path: str | Path) -> None:
        """Write the cloud: .npz (everything), .ply, .pcd, or .rrd (opens in rerun), by the suffix.

        Raises:
            InvalidInput: another suffix, or a path that cannot be written.
        """
        from srt3d_ros.recording import cloud_files

        cloud_files.save(self, path, frequencies=tuple(self.facts.get("frequencies", ())), sensor=self.sensor)

    def plot(self, path: str | Path | None = None, ax: "Axes | None" = None, *, yaw_deg: float = -20,
             pitch_deg: float = 10, size_px: tuple[int, int] = (1200, 900)) -> "Image":
        """The cloud as a picture: coloured by range, shaded by intensity, with a scale bar.

        Args:
            path: where to write it, if given: .png, .jpg, ….
            ax: of matplotlib, to draw it into, if given.
            yaw_deg, pitch_deg: from where it is seen: to the right of the sensor and above it.
            size_px: width and height of the picture.

        Returns:
            A Pillow image, which a notebook shows.

        Raises:
            InvalidInput: a path that cannot be written, or matplotlib or Pillow is missing.
        """
        try:
            from srt3d_ros.pictures import annotations
            from srt3d_ros.pictures.cloud_renderer import CloudStyle
        except ImportError as error:
            raise InvalidInput("plot", f"{error}", "pip install 'srt3d_ros[review]' to have been run") from None
        from srt3d_ros.core.viewpoint import look_at

        width, height = size_px
        eye = look_at(self.xyz, self.sensor.projection, yaw_deg, pitch_deg, aspect=width / height)
        style = CloudStyle.of(self, self.sensor)
        image = annotations.annotated(style.draw(self, eye, width, height), style, eye)
        if ax is not None:
            ax.imshow(image)
            ax.set_axis_off()
        if path is not None:
            try:
                image.save(path)
            except (OSError, ValueError) as error:
                raise InvalidInput("picture", str(path), f"a file that can be written ({error})") from None
        return image


@dataclass(frozen=True, eq=False, repr=False)
class Sketch(core_sketch.Sketch):
    """What is kept of a frame's photons, and the sensor that saw them.

    Sketches of the same frequencies add. `sketch[10:40, 20:50]` is that of a window of pixels, with the sensor of these
    alone.

    Args:
        frequencies: the integers k_l.
        sums: complex64 [rows, cols, m], Σ exp(i ω_l x) over a pixel's photons.
        photons: uint32 [rows, cols], their number.
        sensor: of the photons, behind the gate if there is one.
        notes: one line each for what was assumed, estimated or left out.
    """

    sensor: SensorModel = field(kw_only=True)
    notes: tuple[str, ...] = field(kw_only=True, default=())

    def __repr__(self) -> str:
        rows, cols, m = self.sums.shape
        text = f"Sketch of {self.photons.sum():,} photons, {m} numbers in each of {rows} × {cols} pixels"
        return "\n".join([text, *self.notes])

    def __add__(self, other: "Sketch") -> "Sketch":
        """The sketch of both sets of photons; InvalidInput unless frequencies and sensor are the same."""
        require(self.sensor.same_as(other.sensor), "sensor", "another", "the same in both sketches")
        return super().__add__(other)

    def __getitem__(self, pixels: slice | tuple[slice, slice]) -> "Sketch":
        """The sketch of a window of pixels; InvalidInput if none is in it."""
        rows, cols = pixels if isinstance(pixels, tuple) and len(pixels) == 2 else (pixels, slice(None))
        return Sketch(self.frequencies, self.sums[rows, cols], self.photons[rows, cols], self.stamp_ns,
                      sensor=self.sensor.cropped(rows, cols), notes=self.notes)

    def save(self, path: str | Path) -> None:
        """Write an .npz sketch file (docs/photon-file.md)."""
        sketch_file.save(path, self, self.sensor)

    @classmethod
    def load(cls, path: str | Path) -> "Sketch":
        """Read an .npz sketch file."""
        found, sensor = sketch_file.read(path)
        return cls(**vars(found), sensor=sensor)


def open(path: str | Path, frame: int = 0, photons_topic: str = "", **options: Any) -> Photons:
    """The photons of a file or bag, with their sensor and what the file knows of the truth.

    Args:
        path: .npz (docs/photon-file.md), .mat as published, or a bag (docs/bags.md).
        frame: which message of a bag's photons, from 0.
        photons_topic: where a bag's photons are, if it has several topics of them.
        options: what the file does not say, or says wrongly: num_bins, bin_width_s, irf, irf_ref, fov_deg, gate, ….

    Raises:
        InvalidInput: naming the file and what cannot be used.
    """
    return open_photons(path, frame, photons_topic, **options)


def photons(row: Any = None, col: Any = None, toa: Any = None, *, counts: Any = None, sensor: SensorModel | None = None,
            stamp_ns: int = 0, **options: Unpack[SensorOptions]) -> Photons:
    """Photons in memory, with their sensor: one entry of row, col and toa for each, in any order, or counts.

    Arrays and lists of any integer or float type, of NumPy or torch; tensors are copied from their device.

    Args:
        row, col: [N], the pixel of each photon; or instead of `row` what is there already: Photons, or a frame of
            srt3d_ros.core.photons with its `sensor`.
        toa: [N], time of arrival in bins, 0 ≤ toa < T. Integers are whole bins, floats positions: see Sensor.
        counts: [rows, cols, bins], photons in each bin, instead of row, col and toa. Negative where the sensor has
            subtracted ambient light.
        sensor: all that the photons do not say; or say it by options, which also win over what the sensor says.
        stamp_ns: start of acquisition, nanoseconds.
        options: shape=(rows, cols), num_bins, bin_width_s, irf, irf_ref, fov_deg or projection, and the other arguments
            of Sensor. Counts say shape and num_bins themselves. Without irf it is estimated from the photons, without
            fov_deg and projection a pinhole of 30° is assumed; notes say so.

    Raises:
        InvalidInput: naming the argument that is missing or cannot be used.
    """
    if counts is not None:
        require(row is None and col is None and toa is None, "counts", "given beside photons", "one or the other")
        return arrays.from_counts(counts, sensor, stamp_ns, options)
    if isinstance(row, Photons | PhotonEvents | PhotonGates | PhotonHistograms):
        require(col is None and toa is None, "col and toa", "given", "none beside photons that have theirs")
        return arrays.completed(row, sensor, options)
    return arrays.from_events(row, col, toa, sensor, stamp_ns, options)


def sketch(row: Any = None, col: Any = None, toa: Any = None, *, counts: Any = None, sensor: SensorModel | None = None,
           frequencies: str | Sequence[int] = "auto", sketch_size: int | None = None,
           gate: str | tuple[int, int] = OFF, stamp_ns: int = 0, **options: Unpack[SensorOptions]) -> Sketch:
    """The sketch of photons: m complex numbers a pixel, whatever the number of photons.

    Args:
        row, col, toa, counts, sensor, stamp_ns, options: as of `photons`.
        frequencies: which numbers are kept: of least expected error for these photons ("auto"), "spread" over what the
            IRF passes, "consecutive" from 1 to m, or the integers.
        sketch_size: m, 10 unless given.
        gate: keep the photons of the bins (first, last) only; or "auto": of those in which the histogram of all photons
            shows a scene.

    Raises:
        InvalidInput: naming the argument that is missing or cannot be used.
    """
    seen = photons(row, col, toa, counts=counts, sensor=sensor, stamp_ns=stamp_ns, **options)
    return _sketch(seen, _design(seen, gate, frequencies, sketch_size))


def reconstruct(row: Any = None, col: Any = None, toa: Any = None, *, counts: Any = None,
                sensor: SensorModel | None = None, method: str = DEFAULT_METHOD,
                frequencies: str | Sequence[int] | None = None, sketch_size: int | None = None,
                gate: str | tuple[int, int] = OFF, surfaces: int = 1, device: str = "auto",
                false_alarm_rate: float | None = None, background: str | None = None, weighting: str | None = None,
                upsampling: int | None = None, stamp_ns: int = 0, **options: Unpack[SensorOptions]) -> Cloud:
    """The point cloud of photons or of their sketch.

    Args:
        row, col, toa, counts, sensor, stamp_ns, options: as of `photons`; or instead of `row` a Sketch.
        method: "pooled", "srt3d", "smle", "xcorr" or "rt3d" (docs/algorithm.md).
        frequencies, sketch_size, gate: as of `sketch`; frequencies are those that the method is published with unless
            given.
        surfaces: K, the most surfaces in a pixel.
        device: "cpu", "cuda", or "auto" for the GPU if there is one.
        false_alarm_rate: probability that a pixel with background alone shows a point.
        background: how it spreads over the bins (pooled): as the frame itself shows ("auto"), as the "sensor" says, or
            "flat".
        weighting: W of the data term (smle: "precision", srt3d: "identity").
        upsampling: finer pixels of the cloud along the side of each pixel, at most 4 (pooled).

    Raises:
        InvalidInput: naming the argument that is missing or cannot be used.
    """
    chosen = find(method)
    own = {"surfaces": surfaces, "device": device, "false_alarm_rate": false_alarm_rate, "background": background,
           "weighting": weighting, "upsampling": upsampling}
    sketching = {"frequencies": frequencies, "sketch_size": sketch_size}
    make: Callable[[], Sketch | Photons]
    if isinstance(row, core_sketch.Sketch):
        beside = sketching | options | {"col": col, "toa": toa, "counts": counts, "gate": None if gate == OFF else gate}
        for name, value in beside.items():
            require(value is None, name, value, "nothing beside a sketch, which has its own (or sensor)")
        require(chosen.needs == "sketch", "method", method, f"one that takes sketches: {', '.join(SKETCH_METHODS)}")
        taken = _with_sensor(row, sensor)
        make, sensor, found = lambda: taken, taken.sensor, taken.frequencies
    else:
        seen = photons(row, col, toa, counts=counts, sensor=sensor, stamp_ns=stamp_ns, **options)
        if chosen.needs == "sketch":
            design = _design(seen, gate, chosen.frequencies if frequencies is None else frequencies, sketch_size)
            make, sensor, found = partial(_sketch, seen, design), design.sensor, design.frequencies
        else:
            for name, value in sketching.items():
                require(value is None, name, value, f"nothing: {chosen.name} makes no sketch")
            gated = _gated(seen, gate)
            make, sensor, found = lambda: gated, gated.sensor, ()
    reconstructor = chosen.build(sensor, found, **{name: value for name, value in own.items() if value is not None})
    reconstructor.warm_up()
    source, sketch_ms = _timed(make)
    is_sketch = isinstance(source, Sketch)
    cloud, reconstruct_ms = _timed(reconstructor, source if is_sketch else source.frame)
    facts = {"method": method, "device": reconstructor.device, "rows": sensor.rows, "cols": sensor.cols,
             "num_bins": sensor.num_bins, "photons": int(source.photons.sum()) if is_sketch else source.frame.photons,
             "sketch_size": len(found) or None, "frequencies": list(found), "surfaces": surfaces,
             "upsampling": upsampling or 1, "points": len(cloud), "sketch_ms": sketch_ms if is_sketch else None,
             "reconstruct_ms": reconstruct_ms}
    return Cloud(**vars(cloud), sensor=reconstructor.sensor, facts=facts, notes=source.notes)


def _design(seen: Photons, gate: str | Sequence[int], frequencies: str | Sequence[int], sketch_size: int | None
            ) -> SketchDesign:
    return design_for(seen.frame, seen.sensor, _as_written(gate, ":"), _as_written(frequencies, ","), sketch_size)


def _sketch(seen: Photons, design: SketchDesign) -> Sketch:
    made, gate, notes = sketch_photons(seen.frame, seen.sensor, design.frequencies, design.gate), design.gate, ()
    if gate is not None:
        notes = outside_note(seen.frame.photons - int(made.photons.sum()), seen.frame.photons, gate.first, gate.last)
    return Sketch(**vars(made), sensor=design.sensor, notes=seen.notes + notes)


def _gated(seen: Photons, gate: str | Sequence[int]) -> Photons:
    """The photons inside a gate, one by one, for methods that need each."""
    found = None if gate == OFF else design_for(seen.frame, seen.sensor, _as_written(gate, ":")).gate
    if found is None:
        return seen
    events = seen.frame if isinstance(seen.frame, PhotonEvents) else seen.frame.to_events(seen.sensor)
    return replace(seen, frame=events).gated(found)


def _with_sensor(sketch: core_sketch.Sketch, sensor: SensorModel | None) -> Sketch:
    """The sketch with this sensor, or with its own."""
    if sensor is None:
        require(isinstance(sketch, Sketch), "sensor", "missing", "that of the sketch")
        return sketch
    return Sketch(**vars(sketch) | {"sensor": sensor})


def _as_written(value: Any, mark: str) -> str:
    """Numbers as the command line has them, with marks between; a text as it is."""
    return str(value) if isinstance(value, str) or np.ndim(value) == 0 else mark.join(map(str, value))


def _timed(function: Callable, *arguments: Any) -> tuple[Any, float]:
    """What function(*arguments) returns, and the milliseconds it took."""
    started = time.perf_counter()
    result = function(*arguments)
    return result, round((time.perf_counter() - started) * 1e3, 3)
