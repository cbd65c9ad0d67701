"""`points`: both layouts, is_dense, units, and clouds that others wrote."""

from dataclasses import replace

import numpy as np
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2, PointField

from srt3d_ros.core.cloud import POINT_FIELDS
from srt3d_ros.messages import points_message as points
from srt3d_ros.messages.cdr import read_cloud


def test_is_dense_says_whether_every_point_is_finite(codecs):
    cloud = codecs["points_xyzi"].content
    for x, dense in ((1.0, True), (np.nan, False), (np.inf, False)):
        moved = replace(cloud, xyz=np.array([[1, 2, 3], [x, 5, 6]], np.float32))
        assert read_cloud(points.encode_cdr(moved, "lidar")).is_dense is dense


def test_empty_cloud_is_valid(codecs):
    cloud = codecs["points_xyzi"].content
    cloud = replace(cloud, **{name: getattr(cloud, name)[:0] for name in POINT_FIELDS})
    for layout in ("xyzi", "full"):
        raw = points.encode_cdr(cloud, "lidar", layout)
        message = read_cloud(raw)
        assert (message.height, message.width, message.is_dense) == (1, 0, True)
        assert points.decode_cdr(raw)[1]["xyz"].shape == (0, 3)


def test_organised_cloud_of_others_is_read_row_by_row():
    names, values = ["x", "y", "z", "intensity", "ring"], np.arange(30, dtype="<f4")
    fields = [PointField(name=name, offset=4 * at, datatype=PointField.FLOAT32, count=1)
              for at, name in enumerate(names)]
    message = PointCloud2(height=2, width=3, fields=fields, point_step=20, row_step=60, data=values.tobytes())
    _, columns = points.decode_cdr(serialize_message(message))
    assert columns["xyz"].tolist() == values.reshape(6, 5)[:, :3].tolist()
    assert columns["intensity"].tolist() == values.reshape(6, 5)[:, 3].tolist()
