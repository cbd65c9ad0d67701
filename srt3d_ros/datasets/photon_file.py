"""The npz photon file (docs/photon-file.md): its arrays, and how it is written. `readers.npz` reads it."""

import sys
from dataclasses import astuple
from pathlib import Path

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photons import PhotonEvents, PhotonFrame
from srt3d_ros.errors import require
from srt3d_ros.new_files import check_replaceable, file_errors

NUMBERS = ("rows", "cols", "num_bins", "bin_width_s", "irf_ref", "toa_offset_bins", "range_offset_m")
MAPS = ("gain", "delay_bins", "mask", "background_shape")
TEXTS = ("frame_id", "toa_reference")
OWN = (*NUMBERS, "irf", *MAPS, *TEXTS)                          # arguments of SensorModel
FIRST_REFERENCES = ("ref_depth_ml_bins", "ref_depth_bins")      # the better one first
MAX_SURFACES = 8
OTHER_REFERENCES = tuple(f"ref_depth_bins_{k}" for k in range(2, MAX_SURFACES + 1))
KNOWN = (*OWN, "pixel", "toa", "stamp_ns", *FIRST_REFERENCES, *OTHER_REFERENCES, "fov_deg", "projection",
         "projection_values", "distortion", "gate_words")


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
    check_replaceable(path, "toa")
    events = frame if isinstance(frame, PhotonEvents) else frame.to_events(sensor)
    events.check(sensor)
    projection = sensor.projection
    arrays = {name: getattr(sensor, name) for name in OWN} | {
        "pixel": events.pixel, "toa": events.toa, "stamp_ns": np.int64(events.stamp_ns),
        "projection": projection.kind, "projection_values": astuple(projection)[:4],
        "gate_words": sensor.gates and np.array(astuple(sensor.gates), np.uint16)}
    if getattr(projection, "distortion", None):
        arrays["distortion"] = astuple(projection.distortion)
    if reference_depth_bins is not None:
        surfaces = np.asarray(reference_depth_bins, np.float32)
        surfaces = surfaces[None] if surfaces.ndim == 2 else surfaces
        fits = surfaces.shape[1:] == (sensor.rows, sensor.cols) and 1 <= len(surfaces) <= MAX_SURFACES
        require(fits, "reference_depth_bins shape", np.shape(reference_depth_bins),
                f"[S, {sensor.rows}, {sensor.cols}], S from 1 to {MAX_SURFACES}")
        arrays |= dict(zip((FIRST_REFERENCES[-1], *OTHER_REFERENCES), surfaces))
    with file_errors("photon file", path):
        np.savez_compressed(path, **{name: values for name, values in arrays.items() if values is not None})


def value_of(name: str, array: np.ndarray) -> np.ndarray | float | str:
    """An array as its name wants it: a text, one number, or an array of numbers."""
    if name in (*TEXTS, "projection"):
        require(array.dtype.kind == "U" and array.size == 1, f"{name} dtype", str(array.dtype), "one text")
        codes = array.reshape(1).astype(array.dtype.newbyteorder("=")).view(np.uint32)
        require(bool((codes <= sys.maxunicode).all()), name, "not text in places", "Unicode characters")
        return str(array.item())
    require(array.dtype.kind in "iufb", f"{name} dtype", str(array.dtype), "numbers")
    if name not in (*NUMBERS, "fov_deg", "stamp_ns"):
        return array
    require(array.size == 1, f"{name} shape", array.shape, "one number")
    return array.item()
