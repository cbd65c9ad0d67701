"""Save a point cloud: .npz with everything, .ply and .pcd for other programs, .rrd for the rerun viewer; or draw it."""

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from srt3d_ros.colours import levels, percentile_range, range_table
from srt3d_ros.core.method.cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.errors import printable, require
from srt3d_ros.new_files import atomic_write, check_place, file_errors

PICTURES = (".png", ".jpg", ".jpeg")
_JPEG_QUALITY = 90
_SENSOR_FACTS = ("num_bins", "bin_width_s", "irf_ref", "toa_offset_bins", "range_offset_m", "toa_reference")
_FLOATS = [(name, "<f4") for name in ("x", "y", "z", "intensity")]
_BYTES = [(name, "u1") for name in ("red", "green", "blue")]


def save(cloud: PointCloud, path, *, frequencies: tuple[int, ...], sensor: SensorModel) -> None:
    """Write a cloud in the format that the suffix of `path` names; the file appears whole, or not at all.

    .npz: row, col (uint16), depth_bins (float32: see SensorModel), intensity (expected signal
    photons), depth_std_bins, xyz (float32 [N, 3], metres), surface (uint8), background (float32 [rows, cols], expected
    photons), frequencies, stamp_ns, and of the sensor num_bins, bin_width_s, irf_ref, toa_offset_bins, range_offset_m,
    toa_reference.
    .ply: binary, x y z intensity, and the range's colour as red green blue. .pcd: 0.7, binary, x y z intensity.
    .rrd: a recording of one frame (needs rerun-sdk). .png, .jpg: a picture (needs matplotlib).

    Raises:
        InvalidInput: if the suffix is another or the file cannot be written there.
    """
    path = check(path)
    with file_errors("output", path), atomic_write(path) as part:
        _WRITERS[path.suffix.lower()](cloud, part, frequencies, sensor)


def check(path) -> Path:
    """The path if a cloud could be saved there, as far as can be known before it is written; InvalidInput if not."""
    path = Path(path)
    require(path.suffix.lower() in _WRITERS, "output", str(path), f"a file name that ends in {', '.join(_WRITERS)}")
    package, extra = _NEEDS.get(path.suffix.lower(), ("numpy", ""))
    require(find_spec(package) is not None, "output", path.suffix, f"pip install 'srt3d_ros[{extra}]' to have been run")
    check_place(path)
    return path


def _save_npz(cloud: PointCloud, path: Path, frequencies: tuple[int, ...], sensor: SensorModel) -> None:
    fields = {name: getattr(cloud, name) for name in PointCloud.__dataclass_fields__}
    facts = {name: getattr(sensor, name) for name in _SENSOR_FACTS}
    with open(path, "wb") as file:
        np.savez(file, **fields, frequencies=np.array(frequencies, np.int64), **facts)


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


def _save_rrd(cloud: PointCloud, path: Path, frequencies: tuple[int, ...], sensor: SensorModel) -> None:
    from srt3d_ros.recording.frame_log import save_cloud  # here: rerun is imported for this suffix only

    save_cloud(cloud, path, sensor, {"frequencies": list(frequencies)})


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
    ".npz": _save_npz, ".ply": _save_ply, ".pcd": _save_pcd, ".rrd": _save_rrd,
} | dict.fromkeys(PICTURES, _save_picture)
_NEEDS = {".rrd": ("rerun", "record")} | dict.fromkeys(PICTURES, ("matplotlib", "review"))     # package and extra
