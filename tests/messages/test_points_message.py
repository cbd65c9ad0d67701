"""`points`: both layouts, is_dense, units, and clouds that others wrote."""

from dataclasses import replace

import numpy as np
import pytest

from srt3d_ros.core.point_cloud import POINT_FIELDS
from srt3d_ros.messages import points_message as points
from srt3d_ros.messages.cdr import read_cloud
from srt3d_ros.messages.packing import unpack_cloud
from srt3d_ros.messages.schema_files import cloud_layouts


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


@pytest.mark.parametrize("layout", ["xyzi", "full"])
def test_an_organised_cloud_has_the_first_point_of_each_pixel_and_nan_elsewhere(codecs, layout):
    cloud = codecs["points_xyzi"].content       # (0, 1): a first point; (2, 3): a second one
    raw = points.encode_cdr(cloud, "lidar", layout, organised=True)
    message = read_cloud(raw)
    assert (message.height, message.width, message.is_dense) == (3, 4, False)
    image = unpack_cloud(message, [cloud_layouts("points")[layout]])
    for name in set(image.dtype.names) - {"row", "col", "surface", "background"}:
        assert np.argwhere(np.isfinite(image[name])).tolist() == [[0, 1]], name
    if layout == "full":
        assert np.array_equal(image["background"], cloud.background)
        assert np.array_equal([image["row"], image["col"]], np.indices((3, 4)))
    columns, listed = (points.decode_cdr(some)[1] for some in (raw, points.encode_cdr(cloud, "lidar", layout)))
    assert columns.keys() == listed.keys()
    for name, values in columns.items():
        assert np.array_equal(values, listed[name][:1]) and values.dtype == listed[name].dtype, name
