"""Sensors in .npz files: the arrays that describe one, and the checks of what was read."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from srt3d_ros.core.keys import keys, numbers
from srt3d_ros.core.sensor.bins import HistogramBins
from srt3d_ros.core.sensor.distortion import PlumbBob
from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sensor.projection import Pinhole, Projection
from srt3d_ros.datasets.values import Note
from srt3d_ros.errors import finite, printable, require
from srt3d_ros.files.array_files import read_errors, read_npz_arrays
from srt3d_ros.messages.cdr import MAX_FRAME_ID

KEYS = keys(SensorModel)
SENSOR_FIELDS = tuple(name for name, key in KEYS.items() if not key.array)      # an array each
SENSOR_ARRAYS = (*SENSOR_FIELDS, *filter(None, (key.array for key in KEYS.values())), "projection", "distortion",
                 "histogram_template", "notes", "assumed")
REQUIRED = (*(name for name, key in KEYS.items() if key.required), "projection")      # of a saved cloud or sketch
ONE_NUMBER = (*(name for name in SENSOR_FIELDS if {int, float} & {*KEYS[name].kinds}), "fov_deg", "stamp_ns",
              "surfaces", "sketch_cycles", "photons_in_all")
ONE_TEXT = ("frame_id", "extrinsics", "projection", "kind", "method", "device")
NOTES = {"notes", "assumed"}
VECTORS = ("irf", "background_shape", "projection_values", "distortion", "gate_words")
PROJECTIONS = {kind.kind: kind for kind in get_args(Projection)}
MAX_NOTE = 9_999            # characters; notes name files


def sensor_arrays(sensor: SensorModel, notes: tuple[str, ...]) -> dict[str, np.ndarray]:
    """The arrays of a file that describe a sensor, and `notes` if there are any."""
    projection, bins, gates = sensor.projection, sensor.histograms, sensor.gates
    arrays = {name: getattr(sensor, name) for name in SENSOR_FIELDS} | {
        "projection": projection.kind, "projection_values": _numbers(projection),
        "gate_words": gates and _numbers(gates).astype(np.uint16), "notes": notes or None,
        "assumed": [note.field if isinstance(note, Note) else "" for note in notes] or None}
    if getattr(projection, "distortion", None):
        arrays["distortion"] = _numbers(projection.distortion)
    if bins is not None:
        arrays |= {"histogram_bins": _numbers(bins), "histogram_template": bins.template}
    return {name: np.asarray(value) for name, value in arrays.items() if value is not None}


def _numbers(part: Any) -> np.ndarray:
    """The numbers of a part of a sensor, float64, in the order of its fields."""
    return np.array([*numbers(part).values()], np.float64)


def read_saved(path: Path, names: tuple[str, ...]) -> tuple[SensorModel, dict]:
    """The sensor of a saved cloud or sketch, and the values of its arrays `names`, by name, and `notes`."""
    arrays, _ = read_npz_arrays(path, (*SENSOR_ARRAYS, *names))
    with read_errors(path):
        for name in (*REQUIRED, *names):
            require(name in arrays, name, problem=f"The file has no {name}.")
        values = values_of({name: arrays[name] for name in arrays.keys() & {*SENSOR_ARRAYS, *names}})
        return SensorModel(**sensor_options(values)), {"notes": ()} | values


def sensor_options(values: dict) -> dict:
    """The options that describe a file's sensor."""
    given = {name: values[name] for name in (*SENSOR_FIELDS, "fov_deg") if name in values}
    if "gate_words" in values:
        given["gates"] = GateWords(*map(int, _numbers_of(GateWords, "gate_words", values)))
    if "histogram_bins" in values:
        count, first, width = _numbers_of(HistogramBins, "histogram_bins", values)
        given["histograms"] = HistogramBins(int(count), first, width, values.get("histogram_template"))
    if "projection" in values:
        require(values["projection"] in PROJECTIONS, "projection", values["projection"],
                f"one of {', '.join(PROJECTIONS)}")
        kind = PROJECTIONS[values["projection"]]
        given["projection"] = kind(*_numbers_of(kind, "projection_values", values))
        given.pop("fov_deg", None)
    if "distortion" in values:
        projection = given.get("projection")
        require(isinstance(projection, Pinhole), "distortion", problem="Distortion needs a pinhole projection.")
        given["projection"] = replace(projection, distortion=PlumbBob(*_numbers_of(PlumbBob, "distortion", values)))
    return given


def _numbers_of(kind: type, array: str, values: dict) -> list[float]:
    """The finite numbers of an array with one entry for each number of a class."""
    names = [name for name, key in keys(kind).items() if not key.array]
    expected = f"[{len(names)}]: {', '.join(names)}"
    require(array in values, array, problem=f"The file has no {array} {expected}.")
    require(values[array].shape == (len(names),), f"{array} shape", values[array].shape, expected)
    require(bool(np.isfinite(values[array]).all()), array, values[array].tolist(), "finite numbers")
    return values[array].astype(np.float64).tolist()


def vector(values: np.ndarray) -> np.ndarray:
    """An array with one side above 1, such as MATLAB's 1 × N, as [N]; any other as it is."""
    return values.reshape(-1) if values.size == max(values.shape, default=0) else values


def values_of(arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    """The values of a file's arrays by their names: texts, numbers or arrays; `notes` with the fields `assumed`."""
    texts = {name: [*map(printable, _texts(name, arrays[name].reshape(-1), MAX_NOTE))]
             for name in NOTES & arrays.keys()}
    values = {name: _value_of(name, array) for name, array in arrays.items() if name not in NOTES}
    if "notes" in texts:
        notes, fields = texts["notes"], texts.get("assumed", [])
        values["notes"] = tuple(map(Note, notes, fields + [""] * (len(notes) - len(fields))))
    return values


def _value_of(name: str, array: np.ndarray) -> np.ndarray | float | str:
    if name in ONE_TEXT:
        require(array.size == 1, f"{name} shape", array.shape, "one text")
        return _texts(name, array.reshape(1), MAX_FRAME_ID)[0]
    require(array.dtype.kind in "iufb" or name == "sums", f"{name} dtype", str(array.dtype), "numbers")
    if name not in ONE_NUMBER:
        return vector(array) if name in VECTORS else array
    require(array.size == 1, f"{name} shape", array.shape, "one number")
    number = finite(name, array.item())
    return int(number) if name in KEYS and int in KEYS[name].kinds and number.is_integer() else number


def _texts(name: str, array: np.ndarray, most: int) -> list[str]:
    """The texts of an array [n]; InvalidInput unless they are Unicode of at most so many characters."""
    require(array.dtype.kind == "U" and 0 < array.itemsize <= 4 * most, f"{name} dtype", str(array.dtype),
            f"text of at most {most} characters")
    codes = array.astype(array.dtype.newbyteorder("=")).view(np.uint32)
    require(bool((codes <= sys.maxunicode).all()), name, problem=f"{name} is not valid Unicode.")
    return array.tolist()
