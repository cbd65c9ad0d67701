"""`points` in both layouts, the camera of images, and the versions of the schemas."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from srt3d_ros.core.point_cloud import POINT_FIELDS
from srt3d_ros.core.sensor.distortion import PlumbBob
from srt3d_ros.core.sensor.projection import AngularScan, Pinhole
from srt3d_ros.messages import points_message as points
from srt3d_ros.messages import schema_files
from srt3d_ros.messages.cdr import read_cloud
from srt3d_ros.messages.images_message import camera_info
from srt3d_ros.messages.packing import unpack_cloud
from srt3d_ros.messages.schema_files import cloud_layouts


def test_an_empty_cloud_is_valid_and_is_dense_says_whether_points_are_finite(codecs):
    cloud = codecs["points_xyzi"].content
    for x, dense in ((1.0, True), (np.nan, False), (np.inf, False)):
        moved = replace(cloud, xyz=np.array([[1, 2, 3], [x, 5, 6]], np.float32))
        assert read_cloud(points.encode_cdr(moved, "lidar")).is_dense is dense
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


def test_the_camera_projects_points_onto_pixels_has_the_lens_and_a_scanner_has_none(small_sensor):
    sensor = small_sensor.replace(projection=Pinhole(fx=50.0, fy=60.0, cx=1.5, cy=1.0))
    info = camera_info(sensor, 1_500_000_000, "lidar")
    x, y, z = sensor.xyz(np.array([2]), np.array([3]), np.array([40.0]))[0]
    for matrix, point in ((info.k.reshape(3, 3), [x, y, z]), (info.p.reshape(3, 4), [x, y, z, 1])):
        u, v, w = matrix @ point
        np.testing.assert_allclose([u / w, v / w], [3, 2], atol=1e-5)
    assert (info.height, info.width, info.distortion_model, list(info.d)) == (3, 4, "plumb_bob", [0.0] * 5)
    assert (info.r.reshape(3, 3) == np.eye(3)).all() and (info.binning_x, info.roi.width) == (0, 0)
    assert (info.header.stamp.sec, info.header.stamp.nanosec, info.header.frame_id) == (1, 500_000_000, "lidar")
    lens = Pinhole(50.0, 60.0, 7.5, 5.25, PlumbBob(-0.2, 0.05, 0.01, -0.005, 0.002))
    info = camera_info(small_sensor.replace(projection=lens), 0, "lidar")
    assert list(info.d) == [-0.2, 0.05, 0.01, -0.005, 0.002]
    assert (info.k.reshape(3, 3) == [[50, 0, 7.5], [0, 60, 5.25], [0, 0, 1]]).all()
    scanner = small_sensor.replace(projection=AngularScan(0.1, -0.01, 0.2, -0.01))
    assert camera_info(scanner, 0, "lidar") is None


ROOT = Path(__file__).resolve().parents[2]
NAMES = sorted(path.stem for path in (ROOT / "msg_schemas").glob("*.json"))


@pytest.mark.parametrize("name", NAMES)
def test_a_schema_is_of_the_draft_that_it_names_and_has_a_version(name):
    schema = schema_files.load(name)
    assert schema["$schema"] == Draft202012Validator.META_SCHEMA["$id"]
    Draft202012Validator.check_schema(schema)
    assert (schema["properties"]["schema_version"]["const"] if name == "sensor" else schema["x-version"]) >= 1
