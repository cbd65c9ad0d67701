"""The npz photon file (docs/photon-file.md): photons of one frame, their sensor and, if known, the true depths."""

from dataclasses import fields, replace
from itertools import takewhile
from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor.distortion import PlumbBob
from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.datasets.arrays import from_pixels
from srt3d_ros.datasets.files import read_errors, read_npz_arrays
from srt3d_ros.datasets.photon_file import FIRST_REFERENCES, KNOWN, OTHER_REFERENCES, OWN, value_of
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.datasets.readers import cubes
from srt3d_ros.datasets.values import MAX_PHOTONS
from srt3d_ros.errors import require
from srt3d_ros.messages.sensor import PROJECTIONS

REQUIRED = ("pixel", "toa", "rows", "cols", "num_bins")


def read(path: Path, options: dict) -> Photons:
    """The content of an npz photon file; arrays with other names are left alone.

    Raises:
        InvalidInput: naming the file and the array that cannot be used.
    """
    arrays = read_npz_arrays(path, KNOWN)
    if not {"pixel", "toa"} & arrays.keys():
        return cubes.read_npz(path, options)
    with read_errors(path):
        values = {name: options[name] for name in OWN if name in options}
        values |= {name: value_of(name, array) for name, array in arrays.items()}
        for name in REQUIRED:
            require(name in values, name, "missing", f"the arrays {', '.join(REQUIRED)}, or options")
        pixel, toa = values["pixel"], values["toa"]
        for name, array in (("pixel", pixel), ("toa", toa)):
            require(array.ndim == 1 and array.shape == pixel.shape, f"{name} shape", array.shape,
                    "[N], one entry a photon")
        require(len(pixel) <= MAX_PHOTONS, "photons", len(pixel), f"at most {MAX_PHOTONS}")
        sensor, events, notes = from_pixels(pixel, toa, int(values.get("stamp_ns", 0)), _of_sensor(values))
        reference = _reference(values, sensor)
    return Photons(sensor, events, reference, path.stem, notes).with_options(options)


def _of_sensor(values: dict) -> dict:
    """What a file says of its sensor, as options."""
    given = {name: values[name] for name in (*OWN, "fov_deg") if name in values}
    if "gate_words" in values:
        given["gates"] = GateWords(*map(int, _numbers_of(GateWords, "gate_words", values)))
    if "projection" in values:
        kind = PROJECTIONS.get(values["projection"])
        require(kind is not None, "projection", values["projection"], f"one of {', '.join(PROJECTIONS)}")
        given["projection"] = kind(*_numbers_of(kind, "projection_values", values))
        given.pop("fov_deg", None)
    if "distortion" in values:
        projection = given.get("projection")
        require(isinstance(projection, Pinhole), "distortion", "there", "none: the projection is no pinhole")
        given["projection"] = replace(projection, distortion=PlumbBob(*_numbers_of(PlumbBob, "distortion", values)))
    return given


def _numbers_of(kind: type, array: str, values: dict) -> list[float]:
    """The numbers of an array for the fields of a class, but for a lens's distortion."""
    names = [field.name for field in fields(kind) if field.name != "distortion"]
    expected = f"[{len(names)}]: {', '.join(names)}"
    require(array in values, array, "missing", expected)
    require(values[array].shape == (len(names),), f"{array} shape", values[array].shape, expected)
    return values[array].astype(np.float64).tolist()


def _reference(values: dict, sensor: SensorModel) -> np.ndarray | None:
    first = next((name for name in FIRST_REFERENCES if name in values), None)
    if first is None:
        return None
    names, shape = [first, *takewhile(values.__contains__, OTHER_REFERENCES)], (sensor.rows, sensor.cols)
    for name in names:
        require(values[name].shape == shape, f"{name} shape", values[name].shape, f"{shape}")
    return np.stack([values[name] for name in names]).astype(np.float32)
