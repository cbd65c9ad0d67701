"""Read .npz and .npy files: photons (docs/photon-file.md), one frame with its sensor, or what `save` wrote."""

from dataclasses import replace
from itertools import takewhile
from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonHistograms
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.datasets import cloud_files
from srt3d_ros.datasets.arrays import from_events, from_frame, from_pixels
from srt3d_ros.datasets.axes import SIZES, in_order
from srt3d_ros.datasets.options import Options
from srt3d_ros.datasets.photon_file import FIRST_REFERENCES, OTHER_REFERENCES
from srt3d_ros.datasets.readers import cubes, words
from srt3d_ros.datasets.reading import Reading
from srt3d_ros.datasets.sensor_arrays import (
    SENSOR_ARRAYS,
    SENSOR_FIELDS,
    read_saved,
    sensor_options,
    values_of,
    vector,
)
from srt3d_ros.datasets.values import MAX_EVENTS, sendable
from srt3d_ros.errors import require
from srt3d_ros.files.array_files import MAX_ARRAY_BYTES, map_npy, npz_contents, read_errors, read_npz_arrays
from srt3d_ros.files.isolated_child import listing

MAX_CUBE_BYTES = 2**46
COLUMNS, PIXEL_COLUMNS = ("row", "col", "toa"), ("pixel", "toa")
KNOWN = (*SENSOR_ARRAYS, "pixel", *COLUMNS, "stamp_ns", *FIRST_REFERENCES, *OTHER_REFERENCES, "fov_deg", "kind")
PHOTONS = "row, col (or pixel) and toa of each photon (other names: --columns ROW,COL,TOA, or srt3d_ros.from_events)"
WANTED = f"one numeric array [rows, cols, bins], or {PHOTONS}"


def read(path: Path, options: Options) -> Reading:
    """Photons of an .npz file, one by one or as counts, or a saved Sketch or Cloud; other arrays are ignored."""
    arrays = read_npz_arrays(path, (*KNOWN, *options.named))
    kind = arrays.pop("kind", None)         # unchecked: it may be anyone's
    if np.array_equal(kind, "cloud"):
        return cloud_files.read(path, options)
    if np.array_equal(kind, "sketch"):
        return _sketch(path, options)
    if not _has_photons(arrays, options):
        arrays = read_npz_arrays(path, (*KNOWN, "counts", *options.named), and_cubes=True)
    return from_arrays(path, arrays, options, WANTED, listing(npz_contents(path)))


def read_npy(path: Path, options: Options) -> Reading:
    """Photons of an .npy file of counts, or of words of a SPAD array."""
    most = MAX_ARRAY_BYTES if options.axes is not None else MAX_CUBE_BYTES         # other axes are copied into memory
    with read_errors(path):
        arrays = {"counts": map_npy(path, f"{path.name} counts", most)}
    return from_arrays(path, arrays, replace(options, array=options.array or "counts"), WANTED, "counts")


def from_arrays(path: Path, arrays: dict[str, np.ndarray], options: Options, wanted: str, listed: str) -> Reading:
    """Photons of a file by the names of its arrays: those of an .npz photon file, or else the only array of counts.

    Args:
        wanted, listed: what the file should have, and what it has, for an error.
    """
    with read_errors(path):
        if options.no_detection is not None:
            arrays, options = words.photons(arrays, options, wanted, listed)
        if has_photons := _has_photons(arrays, options):
            columns = options.columns or (PIXEL_COLUMNS if "pixel" in arrays else COLUMNS)
        elif options.axes or options.array or not arrays.keys() >= {"counts", *SIZES}:
            return cubes.only_cube(path, arrays, options, wanted, listed)
        else:
            columns = ("counts",)
        values = {name: options.known[name] for name in SENSOR_FIELDS if name in options.known}
        values |= values_of({name: array for name, array in arrays.items()
                             if name in KNOWN and name not in ("kind", *PIXEL_COLUMNS, *COLUMNS, *columns)})
        for name in columns:
            require(name in arrays, name, problem=f"The file has no {name}. It needs {PHOTONS}. It has {listed}.")
        if has_photons and len(columns) == 1:
            values = {"rows": 1, "cols": 1} | values
        for name in SIZES:
            require(name in values, name,
                    problem=f"The file has no {name}: give it as an option or array. It has {listed}.")
        steps = None if "irf" in arrays else options.known.get("irf_steps")
        own, stamp_ns, frames = sensor_options(values), int(values.get("stamp_ns", 0)), 1
        used = Options(own | {"irf_steps": steps}, guess_irf=options.guess_irf, mask_hot=options.mask_hot,
                       frame=options.frame)
        if has_photons:
            photons = [_column(name, arrays[name]) for name in columns]
            photons = [np.zeros(photons[0].shape, np.uint8), *photons] if len(photons) == 1 else photons
            describe = from_pixels if len(photons) == 2 else from_events
            # The larger num_bins, so that no photon is dropped early.
            larger = used.knowing(num_bins=options.known.get("num_bins", own["num_bins"]))
            sensor, frame, assumed = describe(*photons, stamp_ns, larger)
            sensor = sensor.replace(num_bins=own["num_bins"])
        else:
            sizes = {} if "histograms" in own else {name: own[name] for name in SIZES}
            counts, _, ordered, frames = in_order(arrays["counts"], Options(frame=options.frame), sizes)
            counts = np.ascontiguousarray(sendable(counts))
            sensor, frame, assumed = from_frame(PhotonHistograms(counts, stamp_ns), used)
            assumed = ordered + assumed
        reference = _reference(values, sensor)
    notes = tuple(dict.fromkeys((*values.get("notes", ()), *assumed)))
    return Reading(sensor, frame, reference, path.stem, notes, frames).with_options(options.without("columns"))


def _sketch(path: Path, options: Options) -> Reading:
    """A sketch that `photon_file.save_sketch` wrote; options replace values of its sensor."""
    facts = ("stamp_ns", "sketch_cycles")
    sensor, values = read_saved(path, ("frequencies", "sums", "photons", "before", *facts))
    with read_errors(path):
        before, stamp_ns, cycles = values["before"], *(int(values[name]) for name in facts)
        fits = before.shape in ((0, 0), (sensor.rows, sensor.cols)) and before.dtype == np.uint32
        require(fits, "before", f"{before.dtype} {before.shape}", "uint32 of the sensor's pixels, or none")
        require(cycles >= 0, "sketch_cycles", cycles, "0 or more")
        sums = PhaseSums(values["frequencies"], values["sums"], values["photons"], stamp_ns, cycles,
                         before if before.size else None, sensor=sensor)
    return Reading(sensor, sums, None, path.stem, values["notes"]).with_options(options)


def _has_photons(arrays: dict[str, np.ndarray], options: Options) -> bool:
    """Whether the arrays list photons one by one."""
    return options.columns is not None or not {"pixel", "toa"}.isdisjoint(arrays)


def _column(name: str, values: np.ndarray) -> np.ndarray:
    """Numbers [N] of the photons, also of MATLAB's N × 1 and 1 × N."""
    require(values.dtype.kind in "iufb", f"{name} dtype", str(values.dtype), "numbers")
    require(values.size <= MAX_EVENTS, "photons", values.size, f"at most {MAX_EVENTS}")
    return vector(values)


def _reference(values: dict, sensor: SensorModel) -> np.ndarray | None:
    """Reference depths float32 [S, rows, cols], or None."""
    first = next((name for name in FIRST_REFERENCES if name in values), None)
    if first is None:
        return None
    names = [first, *takewhile(values.__contains__, OTHER_REFERENCES)]
    shape = (sensor.rows, sensor.cols)
    for name in names:
        require(values[name].shape == shape, f"{name} shape", values[name].shape, f"{shape}")
    return np.stack([values[name] for name in names]).astype(np.float32)
