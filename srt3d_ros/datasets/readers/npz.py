"""The npz photon file (docs/photon-file.md): photons of one frame, their sensor and, if known, the true depths."""

from dataclasses import fields, replace
from itertools import takewhile
from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor.distortion import PlumbBob
from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.core.sketching.photons import PhotonEvents
from srt3d_ros.datasets import irf as irfs
from srt3d_ros.datasets.files import naming_file, read_npz_arrays
from srt3d_ros.datasets.options import ASSUMED_FOV, pinhole
from srt3d_ros.datasets.photon_file import FIRST_REFERENCES, INTENSITY, KNOWN, OTHER_REFERENCES, OWN, value_of
from srt3d_ros.datasets.photons import Photons
from srt3d_ros.datasets.readers import cubes
from srt3d_ros.datasets.recording import Recording
from srt3d_ros.datasets.values import MAX_PHOTONS, check_unit, check_within
from srt3d_ros.errors import require
from srt3d_ros.messages.sensor import PROJECTIONS

REQUIRED = ("rows", "cols", "num_bins", "bin_width_s", "pixel", "toa")


def read(path: Path, options: dict) -> Photons | Recording:
    """The content of an npz photon file; arrays with other names are left alone. Of an array of counts a Recording.

    Raises:
        InvalidInput: naming the file and the array that cannot be used.
    """
    arrays = read_npz_arrays(path, KNOWN)
    if not {"pixel", "toa"} & arrays.keys():
        return cubes.read_npz(path, options)
    notes = () if {"projection", "fov_deg"} & arrays.keys() else (ASSUMED_FOV,)
    with naming_file(path):
        values = {name: options[name] for name in OWN if name in options}
        values |= {name: value_of(name, array) for name, array in arrays.items()}
        for name in REQUIRED:
            require(name in values, name, "missing", f"the arrays {', '.join(REQUIRED)}, or options")
        has_irf = "irf" in values
        sensor = _sensor({"irf": np.ones(1)} | values)
        events = _events(values, sensor)
        reference = _reference(values, sensor)
        intensity = _reference_intensity(values, reference)
    if not has_irf:
        response, note = irfs.estimated(events, sensor.num_bins, guess=False)
        sensor, notes = sensor.replace(irf=response, irf_ref=None), (note, *notes)
    return Photons(sensor, events, reference, path.stem, notes, intensity).with_options(options)


def _sensor(values: dict) -> SensorModel:
    given = {name: values[name] for name in OWN if name in values}
    if "gate_words" in values:
        given["gates"] = GateWords(*map(int, _numbers_of(GateWords, "gate_words", values)))
    sensor = SensorModel(**given)
    projection = sensor.projection
    if "projection" in values:
        kind = PROJECTIONS.get(values["projection"])
        require(kind is not None, "projection", values["projection"], f"one of {', '.join(PROJECTIONS)}")
        projection = kind(*_numbers_of(kind, "projection_values", values))
    elif "fov_deg" in values:
        projection = pinhole(sensor.rows, sensor.cols, values["fov_deg"])
    if "distortion" in values:
        require(isinstance(projection, Pinhole), "distortion", "there", "none: the projection is no pinhole")
        projection = replace(projection, distortion=PlumbBob(*_numbers_of(PlumbBob, "distortion", values)))
    return sensor.replace(projection=projection)


def _numbers_of(kind: type, array: str, values: dict) -> list[float]:
    """The numbers of an array for the fields of a class, but for a lens's distortion."""
    names = [field.name for field in fields(kind) if field.name != "distortion"]
    expected = f"[{len(names)}]: {', '.join(names)}"
    require(array in values, array, "missing", expected)
    require(values[array].shape == (len(names),), f"{array} shape", values[array].shape, expected)
    return values[array].astype(np.float64).tolist()


def _events(values: dict, sensor: SensorModel) -> PhotonEvents:
    pixel, toa = values["pixel"], values["toa"]
    for name, array in (("pixel", pixel), ("toa", toa)):
        require(array.ndim == 1, f"{name} shape", array.shape, "[N], one entry a photon")
    require(len(pixel) <= MAX_PHOTONS, "photons", len(pixel), f"at most {MAX_PHOTONS}")
    require(pixel.dtype.kind in "iu", "pixel dtype", str(pixel.dtype), "an integer type, best uint32")
    check_within("pixel", pixel, sensor.pixels)         # before a conversion could wrap around
    check_within("toa", toa, sensor.num_bins)
    check_unit(toa)
    toa = toa.astype(np.float32 if toa.dtype.kind == "f" else np.uint16, copy=False)
    events = PhotonEvents(pixel.astype(np.uint32, copy=False), toa, int(values.get("stamp_ns", 0)))
    events.check(sensor)        # what a float32 is rounded to
    return events


def _reference(values: dict, sensor: SensorModel) -> np.ndarray | None:
    first = next((name for name in FIRST_REFERENCES if name in values), None)
    if first is None:
        return None
    names, shape = [first, *takewhile(values.__contains__, OTHER_REFERENCES)], (sensor.rows, sensor.cols)
    for name in names:
        require(values[name].shape == shape, f"{name} shape", values[name].shape, f"{shape}")
    return np.stack([values[name] for name in names]).astype(np.float32)


def _reference_intensity(values: dict, reference: np.ndarray | None) -> np.ndarray | None:
    """Of the first surface; those of further ones are unknown."""
    if INTENSITY not in values or reference is None:
        return None
    intensity, first = np.full_like(reference, np.nan), values[INTENSITY]
    require(first.shape == reference.shape[1:], f"{INTENSITY} shape", first.shape, f"{reference.shape[1:]}")
    require(not (first < 0).any(), INTENSITY, "negative in places", "0 or more, NaN = unknown")
    intensity[0] = first
    return intensity
