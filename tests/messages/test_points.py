"""`points`: both layouts, is_dense, units, and clouds that others wrote."""

from dataclasses import replace

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2, PointField

from srt3d_ros.core.method.cloud import PointCloud
from srt3d_ros.messages import points
from srt3d_ros.messages.cdr import read_cloud
from srt3d_ros.messages.packing import unpack_cloud
from srt3d_ros.messages.schema import cloud_layouts


@pytest.fixture
def two_in_one_pixel() -> PointCloud:
    """Of 3 × 4 pixels (0, 1) has two points, (2, 3) one."""
    return PointCloud(row=np.array([0, 0, 2], np.uint16), col=np.array([1, 1, 3], np.uint16),
                      depth_bins=np.array([10, 30, 20], np.float32), intensity=np.array([5, 2, 4], np.float32),
                      depth_std_bins=np.array([0.5, 1, 0.25], np.float32),
                      xyz=np.array([[0, 0, 2], [0, 0, 6], [-4, 5, 6]], np.float32),
                      surface=np.array([0, 1, 0], np.uint8), background=np.arange(12, dtype=np.float32).reshape(3, 4))


def test_is_dense_says_whether_every_point_is_finite(codecs):
    cloud = codecs["points_xyzi"].content
    for x, dense in ((1.0, True), (np.nan, False), (np.inf, False)):
        moved = replace(cloud, xyz=np.array([[1, 2, 3], [x, 5, 6]], np.float32))
        assert read_cloud(points.encode_cdr(moved, "lidar")).is_dense is dense


@pytest.mark.parametrize("layout", ["xyzi", "full"])
def test_organised_cloud_has_the_first_point_of_each_pixel_in_its_place(two_in_one_pixel, small_sensor, layout):
    message = read_cloud(points.encode_cdr(two_in_one_pixel, "lidar", layout, small_sensor, organised=True))
    assert (message.height, message.width, message.is_dense) == (3, 4, False)
    grid = unpack_cloud(message, [cloud_layouts("points")[layout]])
    xyz = np.stack([grid[axis] for axis in "xyz"], axis=-1)
    assert xyz[0, 1].tolist() == [0, 0, 2] and xyz[2, 3].tolist() == [-4, 5, 6]
    nothing = np.ones((3, 4), bool)
    nothing[[0, 2], [1, 3]] = False
    assert np.isnan(xyz[nothing]).all() and grid["intensity"].tolist() == [[0, 5, 0, 0], [0] * 4, [0, 0, 0, 4]]
    if layout == "full":
        assert (grid["background"] == two_in_one_pixel.background).all() and (grid["surface"] == 0).all()
        assert (grid["row"] == np.arange(3)[:, None]).all() and (grid["col"] == np.arange(4)).all()
        metres = np.array([0.5, 0.25]) * small_sensor.bin_width_m
        np.testing.assert_allclose(grid["depth_std"][~nothing], metres, rtol=1e-6)
        assert np.isnan(grid["depth_std"][nothing]).all()


def test_empty_cloud_is_valid(codecs, small_sensor):
    cloud = codecs["points_xyzi"].content
    cloud = replace(cloud, **{name: value[:0] for name, value in vars(cloud).items()
                              if name not in ("background", "stamp_ns")})
    for layout in ("xyzi", "full"):
        for organised, shape in ((False, (1, 0, True)), (True, (3, 4, False))):
            raw = points.encode_cdr(cloud, "lidar", layout, small_sensor, organised)
            message = read_cloud(raw)
            assert (message.height, message.width, message.is_dense) == shape
            assert points.decode_cdr(raw)[1]["xyz"].shape == (0, 3)


def test_organised_cloud_of_others_is_read_row_by_row():
    names, values = ["x", "y", "z", "intensity", "ring"], np.arange(30, dtype="<f4")
    fields = [PointField(name=name, offset=4 * at, datatype=PointField.FLOAT32, count=1)
              for at, name in enumerate(names)]
    message = PointCloud2(height=2, width=3, fields=fields, point_step=20, row_step=60, data=values.tobytes())
    _, columns = points.decode_cdr(serialize_message(message))
    assert columns["xyz"].tolist() == values.reshape(6, 5)[:, :3].tolist()
    assert columns["intensity"].tolist() == values.reshape(6, 5)[:, 3].tolist()
