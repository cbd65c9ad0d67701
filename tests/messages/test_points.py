"""`points`: both layouts, is_dense, units, and clouds that others wrote."""

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2, PointField

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import points


@pytest.mark.parametrize(("layout", "names", "step"), [
    ("xyzi", ["x", "y", "z", "intensity"], 16),
    ("full", ["x", "y", "z", "intensity", "depth_std", "background", "row", "col", "surface"], 32)])
def test_layout(codecs, layout, names, step):
    message = codecs[f"points_{layout}"].encode()
    assert [field.name for field in message.fields] == names
    assert (message.height, message.width, message.point_step, message.row_step) == (1, 2, step, 2 * step)
    widths = {PointField.FLOAT32: 4, PointField.UINT16: 2, PointField.UINT8: 1}
    assert all(field.offset % widths[field.datatype] == 0 for field in message.fields)


def test_columns_hold_the_cloud_in_metres(codecs, small_sensor):
    cloud = codecs["points_full"].content
    _, columns = codecs["points_full"].decode(codecs["points_full"].encode())
    assert (columns["xyz"] == cloud.xyz).all() and (columns["intensity"] == cloud.intensity).all()
    assert columns["row"].tolist() == [0, 2] and columns["col"].tolist() == [1, 3]
    assert columns["surface"].tolist() == [0, 1]
    assert columns["background"].tolist() == [1, 11]
    metres = small_sensor.range_m(11) - small_sensor.range_m(10)
    np.testing.assert_allclose(columns["depth_std"], np.array([1, 2]) * metres, rtol=1e-6)


def test_small_layout_has_position_and_intensity_alone(codecs):
    _, columns = codecs["points_xyzi"].decode(codecs["points_xyzi"].encode())
    assert list(columns) == ["xyz", "intensity"]


@pytest.mark.parametrize(("x", "dense"), [(1.0, True), (np.nan, False), (np.inf, False)])
def test_is_dense_says_whether_every_point_is_finite(codecs, x, dense):
    cloud = codecs["points_xyzi"].content
    cloud = PointCloud(**{**vars(cloud), "xyz": np.array([[1, 2, 3], [x, 5, 6]], np.float32)})
    assert points.encode(cloud, "lidar").is_dense is dense


def test_empty_cloud_is_valid(codecs, small_sensor):
    cloud = codecs["points_xyzi"].content
    cloud = PointCloud(**{name: value[:0] if name not in ("background", "stamp_ns") else value
                          for name, value in vars(cloud).items()})
    for layout in ("xyzi", "full"):
        message = points.encode(cloud, "lidar", layout, small_sensor)
        assert message.width == 0 and message.is_dense
        assert points.decode(message)[1]["xyz"].shape == (0, 3)


def test_organised_cloud_of_others_is_read_row_by_row():
    names, values = ["x", "y", "z", "intensity", "ring"], np.arange(30, dtype="<f4")
    fields = [PointField(name=name, offset=4 * at, datatype=PointField.FLOAT32, count=1)
              for at, name in enumerate(names)]
    message = PointCloud2(height=2, width=3, fields=fields, point_step=20, row_step=60, data=values.tobytes())
    _, columns = points.decode(message)
    assert columns["xyz"].tolist() == values.reshape(6, 5)[:, :3].tolist()
    assert columns["intensity"].tolist() == values.reshape(6, 5)[:, 3].tolist()


def test_xyz_owns_its_memory(codecs):
    _, columns = codecs["points_full"].decode_cdr(codecs["points_full"].encode_cdr())
    for column in columns.values():
        assert column.flags.c_contiguous and column.flags.writeable and column.flags.aligned


def test_unknown_layout_or_missing_sensor_is_refused(codecs):
    cloud = codecs["points_xyzi"].content
    with pytest.raises(InvalidInput, match="^layout is xyz: expected xyzi or full"):
        points.encode(cloud, "lidar", "xyz")
    with pytest.raises(InvalidInput, match="^sensor is absent"):
        points.encode_cdr(cloud, "lidar", "full")
