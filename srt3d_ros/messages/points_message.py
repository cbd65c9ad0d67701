"""`points` and `free`: Cloud, and ends of empty rays ⇄ PointCloud2 (msg_schemas/points.json, free.json)."""

import numpy as np

from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.messages import cdr
from srt3d_ros.messages.packing import encode_cloud, unpack_cloud
from srt3d_ros.messages.schema_files import cloud_layouts, fields_of


def encode_cdr(cloud: PointCloud, frame_id: str, layout: str = "xyzi", organised: bool = False) -> bytes:
    """The serialised message of a cloud.

    Args:
        cloud: of one frame.
        frame_id: the tf frame of cloud.xyz.
        layout: "xyzi", or "full", which adds depth_std, background, row, col and surface.
        organised: rows × cols points, the first of each pixel; without one, x, y, z, intensity and depth_std are NaN.
    """
    points = np.zeros(len(cloud), cloud_layouts("points")[layout])
    points["x"], points["y"], points["z"] = cloud.xyz.T
    points["intensity"] = cloud.intensity
    if layout == "full":
        points["depth_std"] = cloud.depth_std_bins * cloud.sensor.bin_width_m
        points["background"] = cloud.background[cloud.row, cloud.col]
        for name in ("row", "col", "surface"):
            points[name] = getattr(cloud, name)
    dense = not organised and bool(np.isfinite(cloud.xyz).all())
    if organised:
        points = _image(points, cloud)
    return encode_cloud(points, cloud.stamp_ns, frame_id, dense)


def decode_cdr(raw: bytes) -> tuple[cdr.Header, dict[str, np.ndarray]]:
    """The points of a serialised message in either layout, or of any cloud with x, y, z and intensity in float32.

    Points whose x, y or z is not finite are left out: in organised clouds they mark pixels without a point.

    Returns:
        The header and the columns: xyz float32 [N, 3] in metres, intensity float32 [N], and if the message has all
        of them, depth_std, background, row, col and surface [N], in the units of the schema.

    Raises:
        InvalidInput: the message breaks the schema.
    """
    cloud, layouts = cdr.CloudMessage.read(raw), cloud_layouts("points")
    present = {field.name for field in cloud.fields}
    layout = layouts["full" if present.issuperset(fields_of(layouts["full"])) else "xyzi"]
    points = unpack_cloud(cloud, [layout]).reshape(-1)
    columns = {"xyz": _xyz(points)}
    for name in list(fields_of(layout))[3:]:
        columns[name] = points[name].astype(layout[name])
    placed = np.isfinite(columns["xyz"]).all(axis=1)
    return cloud.header, columns if placed.all() else {name: values[placed] for name, values in columns.items()}


def _image(points: np.ndarray, cloud: PointCloud) -> np.ndarray:
    """The first point of each pixel, [rows, cols]; a pixel without one keeps row, col and background."""
    image = np.zeros(cloud.background.shape, points.dtype)
    fields = fields_of(points.dtype)
    for name, (kind, _) in fields.items():
        if kind.kind == "f":
            image[name] = np.nan
    if "row" in fields:
        image["row"], image["col"] = np.indices(image.shape)
        image["background"] = cloud.background
    first = cloud.surface == 0
    image[cloud.row[first], cloud.col[first]] = points[first]
    return image


def encode_ends_cdr(free_m: np.ndarray, sensor: SensorModel, stamp_ns: int, frame_id: str) -> bytes:
    """The serialised message of ranges up to which pixels are empty: float32 [rows, cols], metres, NaN = unknown."""
    known = np.isfinite(free_m)
    points = np.empty(int(known.sum()), cloud_layouts("free")["xyz"])
    points["x"], points["y"], points["z"] = (sensor.rays[known] * free_m[known, None]).T
    return encode_cloud(points, stamp_ns, frame_id)


def decode_ends_cdr(raw: bytes) -> tuple[cdr.Header, np.ndarray]:
    """The header and the ends, float32 [N, 3], metres; InvalidInput if the message breaks the schema."""
    cloud = cdr.CloudMessage.read(raw)
    return cloud.header, _xyz(unpack_cloud(cloud, [cloud_layouts("free")["xyz"]]).reshape(-1))


def _xyz(points: np.ndarray) -> np.ndarray:
    """The fields x, y and z, float32 [N, 3], a copy."""
    return np.stack([points[axis] for axis in "xyz"], axis=-1, dtype=np.float32)
