"""The npz photon file (docs/photon-file.md): photons of one frame, their sensor and, if known, the true depths."""

import sys
from dataclasses import astuple, replace
from itertools import takewhile
from pathlib import Path

import numpy as np

from srt3d_ros.core.distortion import PlumbBob
from srt3d_ros.core.photons import MAX_T_NS, PhotonEvents, PhotonFrame
from srt3d_ros.core.projection import AngularScan, Pinhole, Projection
from srt3d_ros.core.scan_rate import ScanRate
from srt3d_ros.core.sensor import GateWords, SensorModel
from srt3d_ros.datasets.files import naming_file, read_npz_arrays, require_file
from srt3d_ros.datasets.photons import ASSUMED_FOV, MAX_PHOTONS, Photons, pinhole
from srt3d_ros.errors import InvalidInput, require

REQUIRED = ("rows", "cols", "num_bins", "bin_width_s", "pixel", "toa", "irf")
SCALARS = ("irf_ref", "toa_offset_bins", "range_offset_m")
MAPS = ("gain", "delay_bins", "mask", "background_shape")
PROJECTIONS = {"pinhole": (Pinhole, ("fx", "fy", "cx", "cy")),
               "angular_scan": (AngularScan, ("azimuth_start_rad", "azimuth_step_rad",
                                              "elevation_start_rad", "elevation_step_rad"))}
FIRST_REFERENCES = ("ref_depth_ml_bins", "ref_depth_bins")      # the better one first
MAX_SURFACES = 8
OTHER_REFERENCES = tuple(f"ref_depth_bins_{k}" for k in range(2, MAX_SURFACES + 1))
INTENSITY = "ref_refl_photons"
TEXTS = ("frame_id", "toa_reference")
KNOWN = (*REQUIRED, *SCALARS, *MAPS, *TEXTS, *FIRST_REFERENCES, *OTHER_REFERENCES, INTENSITY, "fov_deg", "projection",
         "projection_values", "distortion", "gate_words", "scan", "stamp_ns", "t_ns")


def read(path: str | Path) -> Photons:
    """The content of an npz photon file; arrays with other names are left alone.

    Raises:
        InvalidInput: naming the file and the array that cannot be used.
    """
    path = Path(path)
    require_file(path, "photon file")
    arrays = read_npz_arrays(path, KNOWN)
    with naming_file(path):
        for name in REQUIRED:
            require(name in arrays, name, "missing", f"the arrays {', '.join(REQUIRED)}")
        sensor = _sensor(arrays)
        events = _events(arrays, sensor)
        reference = _reference(arrays, sensor)
        intensity = _reference_intensity(arrays, reference)
    notes = () if {"projection", "fov_deg"} & arrays.keys() else (ASSUMED_FOV,)
    return Photons(sensor, events, reference, path.stem, notes, intensity)


def save(path: str | Path, sensor: SensorModel, frame: PhotonFrame,
         reference_depth_bins: np.ndarray | None = None) -> None:
    """Write an npz photon file.

    Args:
        path: ends in .npz.
        frame: photons; gates are written as events.
        reference_depth_bins: [rows, cols] or [S, rows, cols], NaN = unknown or no surface.

    Raises:
        InvalidInput: another suffix, photons outside the sensor, a reference of another shape, a path that cannot be
            written.
    """
    path = Path(path)
    require(path.suffix.lower() == ".npz", "photon file", path.name, "a name that ends in .npz")
    events = frame if isinstance(frame, PhotonEvents) else frame.to_events(sensor)
    events.check(sensor)
    kind = sensor.projection.kind
    arrays = {"rows": sensor.rows, "cols": sensor.cols, "num_bins": sensor.num_bins, "bin_width_s": sensor.bin_width_s,
              "irf": sensor.irf, "pixel": events.pixel, "toa": events.toa, "stamp_ns": np.int64(events.stamp_ns),
              "projection": kind,
              "projection_values": np.array([getattr(sensor.projection, name) for name in PROJECTIONS[kind][1]])}
    arrays |= {name: getattr(sensor, name) for name in (*SCALARS, *MAPS, *TEXTS) if getattr(sensor, name) is not None}
    if getattr(sensor.projection, "distortion", None):
        arrays["distortion"] = np.array(astuple(sensor.projection.distortion))
    if sensor.gates is not None:
        arrays["gate_words"] = np.array([sensor.gates.first_word, sensor.gates.no_detection], np.uint16)
    if sensor.scan is not None:
        arrays["scan"] = np.array(astuple(sensor.scan))
    if events.t is not None:
        arrays["t_ns"] = events.t
    if reference_depth_bins is not None:
        surfaces = np.asarray(reference_depth_bins, np.float32)
        surfaces = surfaces[None] if surfaces.ndim == 2 else surfaces
        fits = surfaces.shape[1:] == (sensor.rows, sensor.cols) and 1 <= len(surfaces) <= MAX_SURFACES
        require(fits, "reference_depth_bins shape", np.shape(reference_depth_bins),
                f"[S, {sensor.rows}, {sensor.cols}], S from 1 to {MAX_SURFACES}")
        arrays |= dict(zip((FIRST_REFERENCES[-1], *OTHER_REFERENCES), surfaces))
    try:
        np.savez_compressed(path, **arrays)
    except OSError as error:
        raise InvalidInput("photon file", str(path), f"a path that can be written ({error.strerror})") from None


def _sensor(arrays: dict[str, np.ndarray]) -> SensorModel:
    known = {name: _scalar(arrays, name) for name in ("rows", "cols", "num_bins", "bin_width_s", *SCALARS)
             if name in arrays}
    known |= {name: _numbers(arrays, name) for name in ("irf", *MAPS) if name in arrays}
    known |= {name: _text(arrays, name) for name in TEXTS if name in arrays}
    if "gate_words" in arrays:
        words = _numbers(arrays, "gate_words", (2,), "[2]: first word, no-detection word")
        known["gates"] = GateWords(int(words[0]), int(words[1]))
    if "scan" in arrays:
        values = _numbers(arrays, "scan", (3,), "[3]: row_period_s, col_period_s, start_s")
        known["scan"] = ScanRate(*(float(value) for value in values))
    sensor = SensorModel(**known)
    projection = _projection(arrays, sensor)
    if "distortion" in arrays:
        require(isinstance(projection, Pinhole), "distortion", "there", "none: the projection is no pinhole")
        values = _numbers(arrays, "distortion", (5,), "[5]: k1, k2, p1, p2, k3")
        projection = replace(projection, distortion=PlumbBob(*(float(value) for value in values)))
    return sensor.replace(projection=projection)


def _projection(arrays: dict[str, np.ndarray], sensor: SensorModel) -> Projection:
    if "projection" in arrays:
        kind = _text(arrays, "projection")
        require(kind in PROJECTIONS, "projection", kind, f"one of {', '.join(PROJECTIONS)}")
        projection, names = PROJECTIONS[kind]
        require("projection_values" in arrays, "projection_values", "missing", f"[{', '.join(names)}]")
        values = _numbers(arrays, "projection_values", (4,), f"[4]: {', '.join(names)}")
        return projection(*(float(value) for value in values))
    if "fov_deg" in arrays:
        return pinhole(sensor.rows, sensor.cols, _scalar(arrays, "fov_deg"))
    return sensor.projection


def _events(arrays: dict[str, np.ndarray], sensor: SensorModel) -> PhotonEvents:
    pixel, toa = _numbers(arrays, "pixel"), _numbers(arrays, "toa")
    for name, values in (("pixel", pixel), ("toa", toa)):
        require(values.ndim == 1, f"{name} shape", values.shape, "[N], one entry a photon")
    require(len(pixel) <= MAX_PHOTONS, "photons", len(pixel), f"at most {MAX_PHOTONS}")
    require(pixel.dtype.kind in "iu", "pixel dtype", str(pixel.dtype), "an integer type, best uint32")
    _within("pixel", pixel, sensor.pixels)              # before a conversion could wrap around
    if toa.dtype.kind in "iu":
        _within("toa", toa, sensor.num_bins)
    toa = toa.astype(np.float32 if toa.dtype.kind == "f" else np.uint16, copy=False)
    stamp_ns = int(_scalar(arrays, "stamp_ns")) if "stamp_ns" in arrays else 0
    t = _numbers(arrays, "t_ns") if "t_ns" in arrays else None
    if t is not None:
        require(t.dtype.kind in "iu" and t.shape == toa.shape, "t_ns", f"{t.dtype} {t.shape}",
                "nanoseconds, best uint32, one entry a photon")
        _within("t_ns", t, MAX_T_NS + 1)
        t = t.astype(np.uint32, copy=False)
    events = PhotonEvents(pixel.astype(np.uint32, copy=False), toa, stamp_ns, t)
    events.check(sensor)
    return events


def _within(name: str, values: np.ndarray, end: int) -> None:
    if len(values):
        low, high = int(values.min()), int(values.max())
        require(0 <= low and high < end, name, low if low < 0 else high, f"0 to {end - 1}")


def _reference(arrays: dict[str, np.ndarray], sensor: SensorModel) -> np.ndarray | None:
    first = next((name for name in FIRST_REFERENCES if name in arrays), None)
    if first is None:
        return None
    names = [first, *takewhile(arrays.__contains__, OTHER_REFERENCES)]
    return np.stack([_numbers(arrays, name, (sensor.rows, sensor.cols)) for name in names]).astype(np.float32)


def _reference_intensity(arrays: dict[str, np.ndarray], reference: np.ndarray | None) -> np.ndarray | None:
    """Of the first surface; those of further ones are unknown."""
    if INTENSITY not in arrays or reference is None:
        return None
    intensity = np.full_like(reference, np.nan)
    first = _numbers(arrays, INTENSITY, reference.shape[1:])
    require(not (first < 0).any(), INTENSITY, "negative in places", "0 or more, NaN = unknown")
    intensity[0] = first
    return intensity


def _scalar(arrays: dict[str, np.ndarray], name: str) -> float | int:
    value = _numbers(arrays, name)
    require(value.size == 1, f"{name} shape", value.shape, "one number")
    return value.item()


def _numbers(arrays: dict[str, np.ndarray], name: str, shape: tuple[int, ...] | None = None,
             expected: str = "") -> np.ndarray:
    """The array, which must hold numbers and be of this shape, if one is given; `expected` says it in words."""
    values = arrays[name]
    require(values.dtype.kind in "iufb", f"{name} dtype", str(values.dtype), "numbers")
    require(shape in (None, values.shape), f"{name} shape", values.shape, expected or f"{list(shape or ())}")
    return values


def _text(arrays: dict[str, np.ndarray], name: str) -> str:
    text = arrays[name]
    require(text.dtype.kind == "U" and text.size == 1, f"{name} dtype", str(text.dtype), "one text")
    codes = text.reshape(1).astype(text.dtype.newbyteorder("=")).view(np.uint32)
    require(bool((codes <= sys.maxunicode).all()), name, "not text in places", "Unicode characters")
    return str(text.item())
