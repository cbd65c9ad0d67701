"""Read .npz and .npy files: photons (docs/photon-file.md), one frame with its sensor, or what `save` wrote."""

from dataclasses import replace
from itertools import takewhile
from pathlib import Path

import numpy as np

from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.datasets import cloud_files
from srt3d_ros.datasets.arrays import from_counts, from_photons, with_options
from srt3d_ros.datasets.axes import SIZES, choose
from srt3d_ros.datasets.options import Options
from srt3d_ros.datasets.photon_file import FIRST_REFERENCES, OTHER_REFERENCES
from srt3d_ros.datasets.readers import words
from srt3d_ros.datasets.reading import Reading, Said
from srt3d_ros.datasets.sensor_arrays import SENSOR_ARRAYS, read_saved, sensor_options, values_of, vector
from srt3d_ros.datasets.values import MAX_EVENTS
from srt3d_ros.errors import require
from srt3d_ros.files.array_files import MAX_ARRAY_BYTES, map_npy, read_errors, read_npz_arrays

MAX_CUBE_BYTES = 2**46
COLUMNS, PIXEL_COLUMNS = ("row", "col", "toa"), ("pixel", "toa")
PHOTON_ARRAYS = ("counts", "pixel", *COLUMNS)
KNOWN = (*SENSOR_ARRAYS, *PHOTON_ARRAYS, "stamp_ns", *FIRST_REFERENCES, *OTHER_REFERENCES, "fov_deg", "kind")
# Arrays beside any counts that describe the sensor.
BESIDE = ("irf", "irf_ref", "bin_width_s", "toa_offset_bins", "range_offset_m", "cycles", "dead_time_s", "period_s",
          "fov_deg")
PHOTONS = "row, col (or pixel) and toa of each photon (other names: --columns ROW,COL,TOA, or srt3d_ros.from_events)"
WANTED = f"one numeric array [rows, cols, bins], or {PHOTONS}"


def read(path: Path, options: Options) -> Reading:
    """Photons of an .npz file, one by one or as counts, or a saved Sketch or Cloud; other arrays are ignored."""
    arrays, listed = read_npz_arrays(path, (*KNOWN, *options.named))
    kind = arrays.pop("kind", None)         # unchecked: it may be anyone's
    if np.array_equal(kind, "cloud"):
        return cloud_files.read(path, options)
    if np.array_equal(kind, "sketch"):
        return _sketch(path, options)
    return from_arrays(path, arrays, options, WANTED, listed)


def read_npy(path: Path, options: Options) -> Reading:
    """Photons of an .npy file of counts, or of words of a SPAD array."""
    most = MAX_ARRAY_BYTES if options.axes is not None else MAX_CUBE_BYTES         # other axes are copied into memory
    with read_errors(path):
        arrays = {"counts": map_npy(path, f"{path.name} counts", most)}
    return from_arrays(path, arrays, replace(options, array=options.array or "counts"), WANTED, "counts")


def from_arrays(path: Path, arrays: dict[str, np.ndarray], options: Options, wanted: str, listed: str) -> Reading:
    """Photons of a file by the names of its arrays: those of an .npz photon file, or else an array of counts.

    Args:
        wanted, listed: what the file should have, and what it has, for an error.
    """
    with read_errors(path):
        if options.no_detection is not None:
            arrays, options = words.photons(arrays, options, wanted, listed)
        if not _has_photons(arrays, options):
            return _of_counts(path, arrays, options, wanted, listed)
        columns = options.columns or (PIXEL_COLUMNS if "pixel" in arrays else COLUMNS)
        for name in columns:
            require(name in arrays, name, problem=f"The file has no {name}. It needs {PHOTONS}. It has {listed}.")
        photons = [_column(name, arrays[name]) for name in columns]
        said = _said(path, arrays, columns)
        if len(photons) == 1:       # of a single pixel
            photons.insert(0, np.zeros(photons[0].shape, np.uint8))
            said.sensor.update({name: 1 for name in SIZES[:2] if name not in options.known | said.sensor})
        for name in SIZES:
            require(name in options.known | said.sensor, name,
                    problem=f"The file has no {name}: give it as an option or array. It has {listed}.")
        return from_photons(tuple(photons), options.without("columns"), said)


def _of_counts(path: Path, arrays: dict[str, np.ndarray], options: Options, wanted: str, listed: str) -> Reading:
    """Photons of the array of counts. Beside other counts than those of a photon file, few names mean something."""
    of_photon_file = arrays.keys() >= {"counts", *SIZES} and not options.axes and not options.array
    name, options = choose(arrays, options, wanted, listed)
    if not of_photon_file:
        sizes = {size for size in SIZES if size in arrays and arrays[size].size == 1}       # others are coordinates
        arrays = {key: arrays[key] for key in (*BESIDE, *sizes, name, f"{name}.dims") if key in arrays}
    dims = tuple(map(str, arrays.get(f"{name}.dims", ())))
    return from_counts(arrays[name], options, _said(path, arrays, (name,)), dims)


def _said(path: Path, arrays: dict[str, np.ndarray], photons: tuple[str, ...]) -> Said:
    """What the arrays beside those of photons say."""
    values = values_of({name: array for name, array in arrays.items()
                        if name in KNOWN and name not in ("kind", *PHOTON_ARRAYS, *photons)})
    first = next((name for name in FIRST_REFERENCES if name in values), "")
    names = [first, *takewhile(values.__contains__, OTHER_REFERENCES)] if first else []
    for name in names:
        fits = values[name].ndim == 2 and values[name].shape == values[first].shape
        require(fits, f"{name} shape", values[name].shape, "[rows, cols]")
    depths = np.stack([values[name] for name in names]).astype(np.float32) if names else None
    return Said(sensor_options(values), values.get("notes", ()), path.stem, depths, int(values.get("stamp_ns", 0)))


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
    return with_options(Reading(sensor, sums, None, path.stem, values["notes"]), options)


def _has_photons(arrays: dict[str, np.ndarray], options: Options) -> bool:
    """Whether the arrays list photons one by one."""
    return options.columns is not None or not {"pixel", "toa"}.isdisjoint(arrays)


def _column(name: str, values: np.ndarray) -> np.ndarray:
    """Numbers [N] of the photons, also of MATLAB's N × 1 and 1 × N."""
    require(values.dtype.kind in "iufb", f"{name} dtype", str(values.dtype), "numbers")
    require(values.size <= MAX_EVENTS, "photons", values.size, f"at most {MAX_EVENTS}")
    return vector(values)
