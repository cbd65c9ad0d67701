"""Read and write .npz photon files (docs/photon-file.md): one frame, its sensor and, if known, the true depths."""

import sys
from dataclasses import astuple, fields, replace
from itertools import takewhile
from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor.distortion import PlumbBob
from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonFrame
from srt3d_ros.datasets.arrays import from_pixels
from srt3d_ros.datasets.options import PIXEL_MAPS
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.datasets.readers import cubes
from srt3d_ros.datasets.values import MAX_EVENTS
from srt3d_ros.errors import require
from srt3d_ros.files.array_files import read_errors, read_npz_arrays
from srt3d_ros.files.new_files import atomic_write, check_replaceable, file_errors
from srt3d_ros.messages.cdr import MAX_FRAME_ID
from srt3d_ros.messages.sensor_message import PROJECTIONS

SCALARS = ("rows", "cols", "num_bins", "bin_width_s", "irf_ref", "toa_offset_bins", "range_offset_m",
           "cycles")
SENSOR_FIELDS = (*SCALARS, "irf", *PIXEL_MAPS, "frame_id")            # arguments of SensorModel
FIRST_REFERENCES = ("ref_depth_ml_bins", "ref_depth_bins")      # the better one first
MAX_REFERENCES = 8
OTHER_REFERENCES = tuple(f"ref_depth_bins_{k}" for k in range(2, MAX_REFERENCES + 1))
KNOWN = (*SENSOR_FIELDS, "pixel", "toa", "stamp_ns", *FIRST_REFERENCES, *OTHER_REFERENCES, "fov_deg", "projection",
         "projection_values", "distortion", "gate_words")
REQUIRED = ("pixel", "toa", "rows", "cols", "num_bins")


def save(path: str | Path, sensor: SensorModel, frame: PhotonFrame,
         reference_depth_bins: np.ndarray | None = None) -> None:
    """Write an .npz photon file atomically.

    Args:
        frame: photons; gates are written as events.
        reference_depth_bins: [rows, cols] or [S, rows, cols], NaN = unknown or no surface.

    Raises:
        InvalidInput: another suffix, photons outside the sensor, a reference of another shape, or a path that cannot be
            written.
    """
    path = Path(path)
    require(path.suffix.lower() == ".npz", "photon file", path.name, "a name that ends in .npz")
    check_replaceable(path, "toa")
    events = frame if isinstance(frame, PhotonEvents) else frame.to_events(sensor)
    events.check(sensor)
    projection = sensor.projection
    arrays = {name: getattr(sensor, name) for name in SENSOR_FIELDS} | {
        "pixel": events.pixel, "toa": events.toa, "stamp_ns": np.int64(events.stamp_ns),
        "projection": projection.kind, "projection_values": astuple(projection)[:4],
        "gate_words": sensor.gates and np.array(astuple(sensor.gates), np.uint16)}
    if getattr(projection, "distortion", None):
        arrays["distortion"] = astuple(projection.distortion)
    if reference_depth_bins is not None:
        surfaces = np.asarray(reference_depth_bins, np.float32)
        surfaces = surfaces[None] if surfaces.ndim == 2 else surfaces
        fits = surfaces.shape[1:] == (sensor.rows, sensor.cols) and 1 <= len(surfaces) <= MAX_REFERENCES
        require(fits, "reference_depth_bins shape", np.shape(reference_depth_bins),
                f"[S, {sensor.rows}, {sensor.cols}], S from 1 to {MAX_REFERENCES}")
        arrays |= dict(zip((FIRST_REFERENCES[-1], *OTHER_REFERENCES), surfaces))
    with file_errors("photon file", path), atomic_write(path) as part, part.open("wb") as file:
        np.savez_compressed(file, **{name: values for name, values in arrays.items() if values is not None})


def read(path: Path, options: dict) -> Photons:
    """Photons of an .npz photon file; arrays with unknown names are ignored."""
    arrays = read_npz_arrays(path, KNOWN)
    if not {"pixel", "toa"} & arrays.keys():
        return cubes.read_npz(path, options)
    with read_errors(path):
        values = {name: options[name] for name in SENSOR_FIELDS if name in options}
        values |= {name: _value_of(name, array) for name, array in arrays.items()}
        for name in REQUIRED:
            require(name in values, name, problem=f"The file has no {name}: give it as an option or array.")
        pixel, toa = values["pixel"], values["toa"]
        require(pixel.size <= MAX_EVENTS, "photons", pixel.size, f"at most {MAX_EVENTS}")
        own = _of_sensor(values)
        used = own | {"num_bins": options.get("num_bins", own["num_bins"])}     # so that no photon is dropped below it
        sensor, events, notes = from_pixels(pixel, toa, int(values.get("stamp_ns", 0)), used)
        sensor, reference = sensor.replace(num_bins=own["num_bins"]), _reference(values, sensor)
    return Photons(sensor, events, reference, path.stem, notes).with_options(options)


def _of_sensor(values: dict) -> dict:
    """The options that describe a file's sensor."""
    given = {name: values[name] for name in (*SENSOR_FIELDS, "fov_deg") if name in values}
    if "gate_words" in values:
        given["gates"] = GateWords(*map(int, _numbers_of(GateWords, "gate_words", values)))
    if "projection" in values:
        kind = PROJECTIONS.get(values["projection"])
        require(kind is not None, "projection", values["projection"], f"one of {', '.join(PROJECTIONS)}")
        given["projection"] = kind(*_numbers_of(kind, "projection_values", values))
        given.pop("fov_deg", None)
    if "distortion" in values:
        projection = given.get("projection")
        require(isinstance(projection, Pinhole), "distortion", problem="Distortion needs a pinhole projection.")
        given["projection"] = replace(projection, distortion=PlumbBob(*_numbers_of(PlumbBob, "distortion", values)))
    return given


def _numbers_of(kind: type, array: str, values: dict) -> list[float]:
    """The numbers of an array with one entry for each field of a class (but `distortion`)."""
    names = [field.name for field in fields(kind) if field.name != "distortion"]
    expected = f"[{len(names)}]: {', '.join(names)}"
    require(array in values, array, problem=f"The file has no {array} {expected}.")
    require(values[array].shape == (len(names),), f"{array} shape", values[array].shape, expected)
    return values[array].astype(np.float64).tolist()


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


def _value_of(name: str, array: np.ndarray) -> np.ndarray | float | str:
    """The value of an array by its name: a text, one number, or the array."""
    if name in ("frame_id", "projection"):
        require(array.dtype.kind == "U" and array.size == 1 and array.itemsize <= 4 * MAX_FRAME_ID, f"{name} dtype",
                str(array.dtype), f"one text of at most {MAX_FRAME_ID} characters")
        codes = array.reshape(1).astype(array.dtype.newbyteorder("=")).view(np.uint32)
        require(bool((codes <= sys.maxunicode).all()), name, problem=f"{name} is not valid Unicode.")
        return str(array.item())
    require(array.dtype.kind in "iufb", f"{name} dtype", str(array.dtype), "numbers")
    if name not in (*SCALARS, "fov_deg", "stamp_ns"):
        return array
    require(array.size == 1, f"{name} shape", array.shape, "one number")
    return array.item()
