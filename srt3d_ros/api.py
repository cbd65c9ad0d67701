"""The library in Python: arrays of photons, photon files and sketches to point clouds. `import srt3d_ros` shows it."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from srt3d_ros.core import sketch as core_sketch
from srt3d_ros.core.gate import OFF, Gate
from srt3d_ros.core.methods import DEFAULT_METHOD, SKETCH_METHODS, Method, find
from srt3d_ros.core.photons import PhotonEvents, PhotonGates, PhotonHistograms
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch_design import SketchDesign, design_for
from srt3d_ros.datasets import Photons, arrays, open_stream
from srt3d_ros.datasets.arrays import SensorOptions
from srt3d_ros.datasets.bags.bag import is_bag
from srt3d_ros.datasets.bags.frames import BagFrames, FramePlace
from srt3d_ros.datasets.files import readable
from srt3d_ros.datasets.photons import OPTIONS as FILE_OPTIONS
from srt3d_ros.datasets.photons import outside_note
from srt3d_ros.datasets.stream import PhotonStream
from srt3d_ros.errors import InvalidInput, require
from srt3d_ros.results import Cloud, Sketch

__all__ = ["Cloud", "InvalidInput", "Photons", "Sensor", "Sketch", "open", "photons", "reconstruct", "sketch"]

Sensor = SensorModel


def open(path: str | Path, frame: int = 0, photons_topic: str = "", **options: Any
         ) -> Photons | PhotonStream | Sketch:
    """The photons of a file or bag, with their sensor and what the file knows of the truth.

    Args:
        path: .npz, .mat, a laboratory's file (.ptu, .sdt, …: docs/photon-file.md), a log of histograms, or a bag
            (docs/bags.md).
        frame: which message of a bag's photons or sketches, or frame of a log, from 0.
        photons_topic: where a bag's photons or sketches are, if it has several topics of them.
        options: what the file does not say, or says wrongly: num_bins, bin_width_s, irf, irf_ref, fov_deg, gate, ….

    Returns:
        Photons; a PhotonStream if they are too many to keep; a Sketch of a bag of sketches. `reconstruct` takes all.

    Raises:
        InvalidInput: naming the file and what cannot be used.
    """
    with readable(path):
        if is_bag(path):
            with BagFrames(path, photons_topic) as frames:
                return open_frame(frames, frames.place(frame), options)
    return open_stream(path, frame, photons_topic, **options)


def open_frame(frames: BagFrames, place: FramePlace, options: dict[str, Any]) -> Photons | Sketch:
    """A frame of a bag as `open` gives it."""
    if not frames.are_sketches:
        return frames.photons(place, options)
    for name, value in options.items():
        require(value is None, name, value, "nothing: the bag has sketches, made without it")
    sensor, sketched = frames.sketch(place)
    return Sketch(**vars(sketched), sensor=sensor)


def photons(row: Any = None, col: Any = None, toa: Any = None, *, counts: Any = None, sensor: SensorModel | None = None,
            stamp_ns: int = 0, **options: Unpack[SensorOptions]) -> Photons | PhotonStream:
    """Photons in memory, with their sensor: one entry of row, col and toa for each, in any order, or counts.

    Arrays and lists of any integer or float type, of NumPy or torch; tensors are copied from their device.

    Args:
        row, col: [N], the pixel of each photon; or instead of `row` what is there already: a file that `open` reads,
            Photons, or a frame of srt3d_ros.core.photons with its `sensor`.
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
    if isinstance(row, str | Path):     # what the file lacks is needed to read it; the rest only describes the sensor
        row = open_stream(row, **{name: options.pop(name) for name in FILE_OPTIONS if name in options})
    if isinstance(row, Photons | PhotonStream | PhotonEvents | PhotonGates | PhotonHistograms):
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
                false_alarm_rate: float | None = None, background: str | None = None, stamp_ns: int = 0,
                **options: Unpack[SensorOptions]) -> Cloud:
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

    Raises:
        InvalidInput: naming the argument that is missing or cannot be used.
    """
    chosen = find(method)
    if isinstance(row, core_sketch.Sketch):
        whole = _with_sensor(chosen, row, sensor, {
            "col": col, "toa": toa, "counts": counts, "frequencies": frequencies, "sketch_size": sketch_size,
            "gate": None if gate == OFF else gate, **options})
        sensor, used, make = whole.sensor, whole.frequencies, lambda: whole
    else:
        seen = photons(row, col, toa, counts=counts, sensor=sensor, stamp_ns=stamp_ns, **options)
        if chosen.needs == "photons":
            for name, value in (("sketch_size", sketch_size), ("frequencies", frequencies)):
                require(value is None, name, value, f"nothing: {method} makes no sketch")
            gated = _gated(seen.read_whole(), gate)
            sensor, used, make = gated.sensor, (), lambda: gated
        else:
            design = _design(seen, gate, chosen.frequencies if frequencies is None else frequencies, sketch_size)
            sensor, used, make = _sketched(seen, design), design.frequencies, partial(_sketch, seen, design)
    own = {"surfaces": surfaces, "device": device, "false_alarm_rate": false_alarm_rate, "background": background}
    reconstructor = chosen.build(sensor, used,
                                 **{name: value for name, value in own.items() if value is not None})
    reconstructor.warm_up()
    given, sketch_ms = _timed(make)
    is_sketch = isinstance(given, Sketch)
    cloud, reconstruct_ms = _timed(reconstructor, given if is_sketch else given.frame)
    facts = {"method": method, "device": reconstructor.device, "rows": sensor.rows, "cols": sensor.cols,
             "num_bins": sensor.num_bins,
             "photons": int(given.photons.sum()) if is_sketch else given.frame.photons,
             "sketch_size": len(used) or None, "frequencies": list(used),
             "surfaces": surfaces, "points": len(cloud),
             "sketch_ms": sketch_ms if is_sketch else None, "reconstruct_ms": reconstruct_ms}
    return Cloud(**vars(cloud), sensor=reconstructor.sensor, facts=facts, notes=given.notes)


def _with_sensor(chosen: Method, given: core_sketch.Sketch, sensor: SensorModel | None, beside: dict[str, Any]
                 ) -> Sketch:
    for name, value in beside.items():
        require(value is None, name, value, "nothing beside a sketch, which has its own (or sensor)")
    require(chosen.needs == "sketch", "method", chosen.name, f"one that takes sketches: {', '.join(SKETCH_METHODS)}")
    require(sensor is not None or isinstance(given, Sketch), "sensor", "missing", "that of the sketch")
    return given if sensor is None else Sketch(**vars(given) | {"sensor": sensor})


def _gated(seen: Photons, gate: Any) -> Photons:
    found = None if gate == OFF else design_for(seen.frame, seen.sensor, _as_written(gate, ":")).gate
    return seen if found is None else seen.gated(found)


def _design(seen: Photons | PhotonStream, gate: Any, frequencies: Any, sketch_size: int | None) -> SketchDesign:
    some = seen.sample
    return design_for(some.frame, some.sensor, _as_written(gate, ":"), _as_written(frequencies, ","), sketch_size)


def _sketched(seen: Photons | PhotonStream, design: SketchDesign) -> SensorModel:
    """The sensor of the sketches: the photons' own, behind the gate if there is one."""
    gate = design.gate
    return seen.sensor if gate is None else Gate(seen.sensor, gate.first, gate.last).sensor


def _sketch(seen: Photons | PhotonStream, design: SketchDesign) -> Sketch:
    gate, notes, photons = design.gate, seen.notes, round(seen.photons)
    made = seen.sketch(design.frequencies, gate)
    if gate is not None:
        notes += outside_note(max(photons - int(made.photons.sum()), 0), photons, gate.first, gate.last)
    return Sketch(**vars(made), sensor=_sketched(seen, design), notes=notes)


def _as_written(value: Any, mark: str) -> str:
    """Numbers as the command line has them, with marks between; a text as it is."""
    return str(value) if isinstance(value, str) or np.ndim(value) == 0 else mark.join(map(str, value))


def _timed(function: Callable, *arguments: Any) -> tuple[Any, float]:
    """What function(*arguments) returns, and the milliseconds it took."""
    started = time.perf_counter()
    result = function(*arguments)
    return result, round((time.perf_counter() - started) * 1e3, 3)
