"""`photons`, `gates`, `histograms` as other drivers write them; `points` and cameras."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2, PointField

from srt3d_ros.core.point_cloud import POINT_FIELDS
from srt3d_ros.core.sensor.distortion import PlumbBob
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import AngularScan, Pinhole
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import cdr, photon_frames
from srt3d_ros.messages import points_message as points
from srt3d_ros.messages.cdr import CloudMessage, Header
from srt3d_ros.messages.images_message import camera_info
from srt3d_ros.messages.packing import unpack_cloud
from srt3d_ros.messages.photon_frames import GATES as gates
from srt3d_ros.messages.photon_frames import HISTOGRAMS as histograms
from srt3d_ros.messages.schema_files import cloud_layouts
from tests.messages.conftest import CODECS, SENSOR, same


@st.composite
def events(draw):
    sensor = SensorModel(rows=draw(st.integers(1, 65_536)), cols=draw(st.integers(1, 64)),
                         num_bins=draw(st.integers(2, 65_535)), bin_width_s=1e-10, irf=np.ones(1))
    count = draw(st.integers(0, 50))
    pixel = draw(arrays.arrays(np.uint32, count, elements=st.integers(0, sensor.pixels - 1)))
    dtype = draw(st.sampled_from([np.uint16, np.float32]))
    bins = st.floats(0, sensor.num_bins, width=32, exclude_max=True) if dtype is np.float32 else \
        st.integers(0, sensor.num_bins - 1)
    toa = draw(arrays.arrays(dtype, count, elements=bins))
    return sensor, PhotonEvents(pixel, toa, draw(st.integers(0, 2**60)))


@settings(max_examples=100, deadline=None)
@given(events())
def test_any_photons_make_the_trip(case):
    sensor, content = case
    header, back = photon_frames.PHOTONS.decode_cdr(photon_frames.PHOTONS.encode_cdr(content, sensor, "spad"), sensor)
    assert header == Header(content.stamp_ns, "spad") and same(back, content)


@pytest.mark.parametrize("name, order", [("gates", ">"), ("histograms_8UC5", "|"), ("histograms_16UC5", ">"),
                                         ("histograms_32FC5", ">")])
def test_images_are_copied_only_where_their_bytes_lie_otherwise(name, order):
    image, whole = cdr.Image.read(CODECS[name].encode_cdr()), vars(CODECS[name].content)
    numbers = whole.get("words", whole.get("counts"))
    rows = numbers.reshape(image.height, -1)
    padded = np.pad(rows, ((0, 0), (0, 3)))
    for lies, copied in ((rows, False), (rows.astype(rows.dtype.newbyteorder(order)), order == ">"), (padded, True)):
        raw = replace(image, is_bigendian=lies.dtype.byteorder == ">", step=lies.strides[0],
                      data=memoryview(lies.tobytes())).write()
        found = vars(CODECS[name].decode_cdr(raw)[1])
        read = found.get("words", found.get("counts"))
        assert (read == numbers).all() and read.flags.aligned and read.flags.c_contiguous and read.dtype.isnative
        assert np.shares_memory(read, np.frombuffer(raw, np.uint8)) is not copied


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("count", [3, 0])
def test_other_order_padding_and_further_fields_are_read(order, count):
    kinds = {"toa": ("f4", PointField.FLOAT32), "tdc": ("u1", PointField.UINT8), "_": ("u1", PointField.UINT8),
             "t": ("u4", PointField.UINT32), "col": ("u2", PointField.UINT16), "row": ("u2", PointField.UINT16)}
    offsets = dict(zip(kinds, (1, 5, 6, 8, 13, 18)))
    points = np.full(3 * 23, 0xAB, np.uint8).view(np.dtype({
        "names": list(kinds), "offsets": list(offsets.values()), "itemsize": 23,
        "formats": [order + kind for kind, _ in kinds.values()]}))
    points["row"], points["col"], points["toa"] = [2, 0, 1], [3, 0, 2], [99.5, 0, 7.25]
    fields = [PointField(name=name, offset=offsets[name], datatype=code, count=1) for name, (_, code) in kinds.items()]
    fields.append(PointField(name="_", offset=7, datatype=PointField.UINT8, count=1))       # a second of this name
    message = PointCloud2(height=1, width=count, fields=fields, is_bigendian=order == ">", point_step=23,
                          row_step=23 * count, data=points[:count].tobytes())
    _, found = photon_frames.PHOTONS.decode_cdr(serialize_message(message), SENSOR)
    assert found.pixel.tolist() == [11, 0, 6][:count] and found.toa.tolist() == [99.5, 0, 7.25][:count]
    assert found.toa.dtype == np.float32


def test_a_frame_that_does_not_fit_the_description_says_what_would():
    raw = CODECS["histograms_16UC5"].encode_cdr()
    with pytest.raises(InvalidInput, match="^encoding is 16UC5: expected 8UC100 or 16UC100 or 32SC100 or 32FC100$"):
        histograms.decode_cdr(raw, SENSOR.replace(histograms=None))
    with pytest.raises(InvalidInput, match="^height is 3: expected the sensor's 6 rows$"):
        histograms.decode_cdr(raw, SENSOR.replace(rows=6))
    with pytest.raises(InvalidInput, match="^sensor.gates is missing"):
        gates.decode_cdr(CODECS["gates"].encode_cdr(), SENSOR.replace(gates=None))


def test_an_empty_cloud_is_valid_and_is_dense_says_whether_points_are_finite():
    cloud = CODECS["points_xyzi"].content
    for x, dense in ((1.0, True), (np.nan, False), (np.inf, False)):
        moved = replace(cloud, xyz=np.array([[1, 2, 3], [x, 5, 6]], np.float32))
        assert CloudMessage.read(points.encode_cdr(moved, "lidar")).is_dense is dense
    cloud = CODECS["points_xyzi"].content
    cloud = replace(cloud, **{name: getattr(cloud, name)[:0] for name in POINT_FIELDS})
    for layout in ("xyzi", "full"):
        raw = points.encode_cdr(cloud, "lidar", layout)
        message = CloudMessage.read(raw)
        assert (message.height, message.width, message.is_dense) == (1, 0, True)
        assert points.decode_cdr(raw)[1]["xyz"].shape == (0, 3)


@pytest.mark.parametrize("layout", ["xyzi", "full"])
def test_an_organised_cloud_has_the_first_point_of_each_pixel_and_nan_elsewhere(layout):
    cloud = CODECS["points_xyzi"].content       # (0, 1): a first point; (2, 3): a second one
    raw = points.encode_cdr(cloud, "lidar", layout, organised=True)
    message = CloudMessage.read(raw)
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


def test_the_camera_projects_points_onto_pixels_has_the_lens_and_a_scanner_has_none():
    sensor = SENSOR.replace(projection=Pinhole(fx=50.0, fy=60.0, cx=1.5, cy=1.0))
    info = camera_info(sensor, 1_500_000_000, "lidar")
    x, y, z = sensor.xyz(np.array([2]), np.array([3]), np.array([40.0]))[0]
    for matrix, point in ((info.k.reshape(3, 3), [x, y, z]), (info.p.reshape(3, 4), [x, y, z, 1])):
        u, v, w = matrix @ point
        np.testing.assert_allclose([u / w, v / w], [3, 2], atol=1e-5)
    assert (info.height, info.width, info.distortion_model, list(info.d)) == (3, 4, "plumb_bob", [0.0] * 5)
    assert (info.r.reshape(3, 3) == np.eye(3)).all() and (info.binning_x, info.roi.width) == (0, 0)
    assert (info.header.stamp.sec, info.header.stamp.nanosec, info.header.frame_id) == (1, 500_000_000, "lidar")
    lens = Pinhole(50.0, 60.0, 7.5, 5.25, PlumbBob(-0.2, 0.05, 0.01, -0.005, 0.002))
    info = camera_info(SENSOR.replace(projection=lens), 0, "lidar")
    assert list(info.d) == [-0.2, 0.05, 0.01, -0.005, 0.002]
    assert (info.k.reshape(3, 3) == [[50, 0, 7.5], [0, 60, 5.25], [0, 0, 1]]).all()
    scanner = SENSOR.replace(projection=AngularScan(0.1, -0.01, 0.2, -0.01))
    assert camera_info(scanner, 0, "lidar") is None
