"""`free`: the ends of empty rays ⇄ PointCloud2 (msg_schemas/free.json)."""

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.messages import cdr
from srt3d_ros.messages.packing import encode_cloud, unpack_cloud, xyz_of
from srt3d_ros.messages.schema_files import cloud_layouts


def encode_cdr(free_m: np.ndarray, sensor: SensorModel, stamp_ns: int, frame_id: str) -> bytes:
    """The serialised message of ranges up to which pixels are empty: float32 [rows, cols], metres, NaN = unknown."""
    known = np.isfinite(free_m)
    points = np.empty(int(known.sum()), cloud_layouts("free")["xyz"])
    points["x"], points["y"], points["z"] = (sensor.rays[known] * free_m[known, None]).T
    return encode_cloud(points, stamp_ns, frame_id)


def decode_cdr(raw: bytes) -> tuple[cdr.Header, np.ndarray]:
    """The header and the ends, float32 [N, 3], metres; InvalidInput if the message breaks the schema."""
    cloud = cdr.read_cloud(raw)
    return cloud.header, xyz_of(unpack_cloud(cloud, [cloud_layouts("free")["xyz"]]).reshape(-1))
