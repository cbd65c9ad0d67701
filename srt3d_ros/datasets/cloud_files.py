"""Save a point cloud as .npz, which `read` reads; for other programs; or as a picture."""

from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from srt3d_ros.core.point_cloud import POINT_FIELDS, PointCloud
from srt3d_ros.core.sketching.sums import as_array
from srt3d_ros.datasets.options import Options
from srt3d_ros.datasets.reading import Reading
from srt3d_ros.datasets.sensor_arrays import read_saved, sensor_arrays
from srt3d_ros.errors import printable, require
from srt3d_ros.files.array_files import read_errors
from srt3d_ros.files.new_files import atomic_write, check_output, file_errors

_JPEG_QUALITY = 90
_TYPES = dict(zip(POINT_FIELDS, (np.uint16, np.uint16, *[np.float32] * 4, np.uint8))) | {"background": np.float32}
_FACTS = {"stamp_ns": "stamp_ns", "method": "method", "surfaces": "surfaces", "device": "device",
          "photons": "photons_in_all", "frequencies": "frequencies"}       # fields of PointCloud: names in the file
_FLOATS = [(name, "<f4") for name in ("x", "y", "z", "intensity")]
_BYTES = [(name, "u1") for name in ("red", "green", "blue")]
_SCALARS = [("depth_std", "<f4"), ("background", "<f4"), ("row", "<u2"), ("col", "<u2"), ("surface", "u1")]
_PLY_TYPES = {"<f4": "float", "<u2": "uint16", "u1": "uchar"}      # Open3D 0.20 skips ushort


def records(cloud: PointCloud) -> np.ndarray:
    """The points as a structured array [N] of x, y, z (metres), intensity (photons), depth_std (metres), background
    (photons of the pixel), row, col, surface."""
    points = np.empty(len(cloud), _FLOATS + _SCALARS)
    points["x"], points["y"], points["z"] = cloud.xyz.T
    points["depth_std"] = cloud.depth_std_bins * cloud.sensor.bin_width_m
    points["background"] = cloud.background[cloud.row, cloud.col]
    for name in ("intensity", "row", "col", "surface"):
        points[name] = getattr(cloud, name)
    return points


def save(cloud: PointCloud, path: str | Path, notes: tuple[str, ...] = ()) -> None:
    """Write a cloud in the format that the suffix of `path` names; the file appears whole, or not at all.

    .npz: row, col (uint16), depth_bins (float32: see SensorModel), intensity (expected signal photons),
    depth_std_bins, xyz (float32 [N, 3], metres), surface (uint8), background (float32 [rows, cols], expected photons),
    stamp_ns, frequencies, notes, method, surfaces, device; and the sensor, as in a photon file. Timings are left out,
    so that files are reproducible.
    .ply: binary, x y z intensity, and the range's colour as red green blue.
    .pcd, .csv: `records`, binary for PCL, and as text with a line of names.
    .tif: the depth image, float32 in metres, NaN = no point (needs Pillow).
    .html: a page in which the cloud can be turned, for any browser.
    .png, .jpg: a picture (needs matplotlib).
    A .ply also has the other fields of `records`, as scalar_depth_std, …: CloudCompare's scalar fields.

    Raises:
        InvalidInput: another suffix, or a file that cannot be written.
    """
    path = check(path)
    with file_errors("output", path), atomic_write(path) as part:
        _FORMATS[path.suffix.lower()][0](cloud, part, notes)


def check(path: str | Path) -> Path:
    """The path; InvalidInput if a cloud cannot be saved there, as far as is known before writing."""
    path = check_output(path, "xyz")
    check_format(path)
    return path


def check_format(path: Path) -> None:
    """Raise InvalidInput for a suffix of no cloud, or whose package is missing."""
    require(path.suffix.lower() in _FORMATS, "output", str(path), f"a file name that ends in {', '.join(_FORMATS)}")
    _, package, extra = _FORMATS[path.suffix.lower()]
    require(not package or find_spec(package) is not None, "output",
            problem=f"Cannot write {path.name}: {package} is missing (pip install '.[{extra}]' in the clone).")


def _save_npz(cloud: PointCloud, path: Path, notes: tuple[str, ...]) -> None:
    facts = {name: np.array(getattr(cloud, field)) for field, name in _FACTS.items()}
    facts["frequencies"] = facts["frequencies"].astype(np.int64)        # none would be floats
    with open(path, "wb") as file:      # NumPy would append .npz to .NPZ
        np.savez(file, kind="cloud", **{name: getattr(cloud, name) for name in _TYPES}, **facts,
                 **sensor_arrays(cloud.sensor, notes))


def read(path: Path, options: Options) -> Reading:
    """A cloud that `save` wrote as .npz; InvalidInput if it is damaged, or for options: its points are final."""
    require(replace(options, guess_irf=False) == Options(), path.name,
            problem=f"{path.name} holds a cloud: no option can change it.")
    sensor, values = read_saved(path, (*_TYPES, *_FACTS.values()))
    with read_errors(path):
        points, pixels = len(values["xyz"]), (sensor.rows, sensor.cols)
        shapes = dict.fromkeys(_TYPES, (points,)) | {"xyz": (points, 3), "background": pixels}
        for name, dtype in _TYPES.items():
            array = values[name]
            require(array.shape == shapes[name] and array.dtype == dtype, name, f"{array.dtype} {array.shape}",
                    f"{np.dtype(dtype)} {shapes[name]}")
            require(name == "depth_std_bins" or bool(np.isfinite(array).all()), name, "not finite in places", "numbers")
        for name, side in zip(("row", "col"), pixels):
            last = int(values[name].max(initial=0))
            require(last < side, name, last, f"below {side}")
        facts = {field: values[name] for field, name in _FACTS.items()}
        facts |= {field: int(facts[field]) for field in ("stamp_ns", "surfaces", "photons")}
        facts["frequencies"] = tuple(as_array("frequencies", facts["frequencies"], 1, "iu").tolist())
        points = PointCloud(**{name: values[name] for name in _TYPES}, **facts, sensor=sensor)
    return Reading(sensor, points, None, path.stem, values["notes"])


def _save_ply(cloud: PointCloud, path: Path, _: tuple[str, ...]) -> None:
    from srt3d_ros.pictures.colours import RANGE_TABLE, levels

    properties = _FLOATS + _BYTES + [(f"scalar_{name}", kind) for name, kind in _SCALARS]
    points, columns = np.empty(len(cloud), properties), records(cloud)
    for name in columns.dtype.names:
        points[name if name in points.dtype.names else f"scalar_{name}"] = columns[name]
    points["red"], points["green"], points["blue"] = RANGE_TABLE[levels(np.linalg.norm(cloud.xyz, axis=1))].T
    frame = printable(cloud.sensor.frame_id)
    header = ["ply", "format binary_little_endian 1.0", f"comment metres in the frame {frame}",
              f"element vertex {len(points)}"]
    header += [f"property {_PLY_TYPES[kind]} {name}" for name, kind in properties]
    path.write_bytes("\n".join([*header, "end_header\n"]).encode() + points.tobytes())


def _save_pcd(cloud: PointCloud, path: Path, _: tuple[str, ...]) -> None:
    points = records(cloud)
    kinds = [points.dtype[name] for name in points.dtype.names]
    header = {"VERSION": [0.7], "FIELDS": points.dtype.names, "SIZE": [kind.itemsize for kind in kinds],
              "TYPE": [kind.kind.upper() for kind in kinds], "COUNT": [1] * len(kinds), "WIDTH": [len(points)],
              "HEIGHT": [1], "VIEWPOINT": [0, 0, 0, 1, 0, 0, 0], "POINTS": [len(points)], "DATA": ["binary"]}
    lines = [" ".join(map(str, (name, *values))) for name, values in header.items()]
    path.write_bytes("\n".join([*lines, ""]).encode() + points.tobytes())


def _save_csv(cloud: PointCloud, path: Path, _: tuple[str, ...]) -> None:
    points = records(cloud)
    forms = ["%.9g" if points.dtype[name].kind == "f" else "%d" for name in points.dtype.names]     # float32 exactly
    np.savetxt(path, points, forms, ",", header=",".join(points.dtype.names), comments="")


def _save_depth(cloud: PointCloud, path: Path, _: tuple[str, ...]) -> None:
    from PIL import Image

    Image.fromarray(cloud.depth_image()).save(path, "TIFF")


def _save_page(cloud: PointCloud, path: Path, notes: tuple[str, ...]) -> None:
    from srt3d_ros.pictures.cloud_page import write_page

    write_page(cloud, records(cloud), path, notes)


def _save_picture(cloud: PointCloud, path: Path, _: tuple[str, ...]) -> None:
    from srt3d_ros.pictures.annotations import draw_cloud

    draw_cloud(cloud).save(path, quality=_JPEG_QUALITY)


# By suffix: what writes it, and the package and extra that this needs.
_FORMATS: dict[str, tuple[Callable[[PointCloud, Path, tuple[str, ...]], None], str, str]] = {
    ".npz": (_save_npz, "", ""), ".ply": (_save_ply, "", ""), ".pcd": (_save_pcd, "", ""), ".csv": (_save_csv, "", ""),
    ".html": (_save_page, "", ""),
    **dict.fromkeys((".tif", ".tiff"), (_save_depth, "PIL", "pictures")),
    **dict.fromkeys((".png", ".jpg", ".jpeg"), (_save_picture, "matplotlib", "pictures"))}
SUFFIXES = (*_FORMATS,)
