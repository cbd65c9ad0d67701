"""Sensors in .npz files: the arrays that describe one, and the checks of what was read."""

import sys
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from srt3d_ros.core.keys import keys, numbers
from srt3d_ros.core.sensor.model import SensorModel
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
    arrays = _arrays_of(sensor) | {
        "projection": sensor.projection.kind, "notes": notes or None,
        "assumed": [note.field if isinstance(note, Note) else "" for note in notes] or None}
    return {name: np.asarray(value) for name, value in arrays.items() if value is not None}


def _arrays_of(part: Any) -> dict[str, Any]:
    """The values of a sensor by the names of their arrays; of a part of it, those that are no plain numbers."""
    arrays = {}
    for name, key in keys(type(part)).items():
        value = getattr(part, name)
        if is_dataclass(value):
            arrays |= {key.array: [*numbers(value).values()], **_arrays_of(value)} if value else {}
        elif key.array or isinstance(part, SensorModel):
            arrays[key.array or name] = value
    return arrays


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
    for name in ("gates", "histograms"):
        if KEYS[name].array in values:
            given[name] = _part(KEYS[name].kinds[0], KEYS[name].array, values)
    if "projection" in values:
        require(values["projection"] in PROJECTIONS, "projection", values["projection"],
                f"one of {', '.join(PROJECTIONS)}")
        given["projection"] = _part(PROJECTIONS[values["projection"]], KEYS["projection"].array, values)
        given.pop("fov_deg", None)
    require("distortion" not in values or isinstance(given.get("projection"), Pinhole), "distortion",
            problem="Distortion needs a pinhole projection.")
    return given


def _part(kind: type, array: str, values: dict) -> Any:
    """A part of a sensor from the array with its numbers, and from those of its other fields."""
    own = keys(kind)
    names = [name for name, key in own.items() if not key.array]
    expected = f"[{len(names)}]: {', '.join(names)}"
    require(array in values, array, problem=f"The file has no {array} {expected}.")
    require(values[array].shape == (len(names),), f"{array} shape", values[array].shape, expected)
    fields = {name: own[name].number(value) for name, value in zip(names, values[array].tolist())}
    for name, key in own.items():
        if key.array in values:
            fields[name] = values[key.array] if key.dtype else _part(key.kinds[0], key.array, values)
    return kind(**fields)


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
