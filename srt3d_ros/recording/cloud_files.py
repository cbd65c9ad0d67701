"""Save a point cloud: .npz with everything, .ply and .pcd for other programs; or draw it."""

import json
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from srt3d_ros.colours import levels, percentile_range, range_table
from srt3d_ros.core.method.cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.datasets.files import read_errors, read_npz_arrays
from srt3d_ros.errors import printable, require
from srt3d_ros.messages import sensor as sensor_message
from srt3d_ros.new_files import atomic_write, check_place, check_replaceable, file_errors

PICTURES = (".png", ".jpg", ".jpeg")
_JPEG_QUALITY = 90
_JSON = ("facts", "notes")
_OF_POINTS = ("row", "col", "depth_bins", "intensity", "depth_std_bins", "xyz", "surface")
_SENSOR_FACTS = ("num_bins", "bin_width_s", "irf_ref", "toa_offset_bins", "range_offset_m", "toa_reference")
_FLOATS = [(name, "<f4") for name in ("x", "y", "z", "intensity")]
_BYTES = [(name, "u1") for name in ("red", "green", "blue")]


def save(cloud: PointCloud, path: str | Path, *, frequencies: tuple[int, ...], sensor: SensorModel) -> None:
    """Write a cloud in the format that the suffix of `path` names; the file appears whole, or not at all.

    .npz: row, col (uint16), depth_bins (float32: see SensorModel), intensity (expected signal
    photons), depth_std_bins, xyz (float32 [N, 3], metres), surface (uint8), background (float32 [rows, cols], expected
    photons), stamp_ns, frequencies; of the sensor num_bins, bin_width_s, irf_ref, toa_offset_bins, range_offset_m,
    toa_reference, and all of it as JSON (sensor), as are facts and notes, which `load` takes.
    .ply: binary, x y z intensity, and the range's colour as red green blue. .pcd: 0.7, binary, x y z intensity.
    .png, .jpg: a picture (needs matplotlib).

    Raises:
        InvalidInput: if the suffix is another or the file cannot be written there.
    """
    path = check(path)
    with file_errors("output", path), atomic_write(path) as part:
        _WRITERS[path.suffix.lower()](cloud, part, frequencies, sensor)


def load(path: str | Path) -> dict[str, Any]:
    """The fields of a library's cloud (results.Cloud) in an .npz that `save` has written; InvalidInput for another."""
    arrays = read_npz_arrays(Path(path), (*PointCloud.__dataclass_fields__, "sensor", *_JSON), "cloud")
    with read_errors(Path(path), "a cloud, as Cloud.save writes it"):
        texts = {name: arrays.pop(name).tobytes().decode() for name in ("sensor", *_JSON)}
        found = PointCloud(**arrays | {"stamp_ns": int(arrays["stamp_ns"])})
        require(all(len(getattr(found, name)) == len(found) for name in _OF_POINTS), "points", "of several numbers",
                "as many in every array")
        sensor = sensor_message.from_json(texts["sensor"])
        require(found.background.shape == (sensor.rows, sensor.cols), "background shape", found.background.shape,
                f"{sensor.rows} × {sensor.cols}, the sensor's pixels")
        return vars(found) | {"sensor": sensor, "facts": json.loads(texts["facts"]),
                              "notes": tuple(map(printable, json.loads(texts["notes"])))}


def check(path: str | Path) -> Path:
    """The path if a cloud could be saved there, as far as can be known before it is written; InvalidInput if not."""
    require(isinstance(path, str | Path), "output", type(path).__name__, "a path")
    path = Path(path)
    require(path.suffix.lower() in _WRITERS, "output", str(path), f"a file name that ends in {', '.join(_WRITERS)}")
    require(path.suffix.lower() not in PICTURES or find_spec("matplotlib") is not None, "output", path.suffix,
            "pip install 'srt3d_ros[review]' to have been run")
    check_place(path)
    check_replaceable(path, "xyz")
    return path


def _save_npz(cloud: PointCloud, path: Path, frequencies: tuple[int, ...], sensor: SensorModel) -> None:
    fields = {name: getattr(cloud, name) for name in PointCloud.__dataclass_fields__}
    of_sensor = {name: getattr(sensor, name) for name in _SENSOR_FACTS}
    facts = {name: value for name, value in getattr(cloud, "facts", {}).items() if not name.endswith("_ms")}
    texts = {"sensor": sensor_message.to_json(sensor), "facts": json.dumps(facts),
             "notes": json.dumps(getattr(cloud, "notes", ()))}
    with open(path, "wb") as file:
        np.savez(file, **fields, frequencies=np.array(frequencies, np.int64), **of_sensor,
                 **{name: np.frombuffer(text.encode(), np.uint8) for name, text in texts.items()})


def _save_ply(cloud: PointCloud, path: Path, _, sensor: SensorModel) -> None:
    points = _records(cloud, _FLOATS + _BYTES)
    range_m = np.linalg.norm(cloud.xyz, axis=1)
    level = levels(range_m, *percentile_range(range_m) or (0, 1))
    points["red"], points["green"], points["blue"] = range_table()[level].T
    header = ["ply", "format binary_little_endian 1.0", f"comment metres in the frame {printable(sensor.frame_id)}",
              f"element vertex {len(points)}"]
    header += [f"property float {name}" for name, _ in _FLOATS] + [f"property uchar {name}" for name, _ in _BYTES]
    _write(path, [*header, "end_header"], points)


def _save_pcd(cloud: PointCloud, path: Path, *_) -> None:
    points = _records(cloud, _FLOATS)
    header = ["# .PCD v0.7 - Point Cloud Data file format", "VERSION 0.7", "FIELDS x y z intensity", "SIZE 4 4 4 4",
              "TYPE F F F F", "COUNT 1 1 1 1", f"WIDTH {len(points)}", "HEIGHT 1", "VIEWPOINT 0 0 0 1 0 0 0",
              f"POINTS {len(points)}", "DATA binary"]
    _write(path, header, points)


def _save_picture(cloud: PointCloud, path: Path, _, sensor: SensorModel) -> None:
    from srt3d_ros.pictures.annotations import draw_cloud

    draw_cloud(cloud, sensor).save(path, quality=_JPEG_QUALITY)


def _records(cloud: PointCloud, fields: list[tuple[str, str]]) -> np.ndarray:
    points = np.empty(len(cloud), fields)
    points["x"], points["y"], points["z"] = cloud.xyz.T
    points["intensity"] = cloud.intensity
    return points


def _write(path: Path, header: list[str], points: np.ndarray) -> None:
    with open(path, "wb") as file:
        file.write(("\n".join(header) + "\n").encode())
        file.write(points.tobytes())


_WRITERS: dict[str, Callable[[PointCloud, Path, tuple[int, ...], SensorModel], None]] = {
    ".npz": _save_npz, ".ply": _save_ply, ".pcd": _save_pcd,
} | dict.fromkeys(PICTURES, _save_picture)
