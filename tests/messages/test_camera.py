"""CameraInfo: where a point of the sensor is seen, regions and binned pixels, and cameras that cannot be used."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import CameraInfo, RegionOfInterest

from srt3d_ros.core.distortion import PlumbBob
from srt3d_ros.core.projection import AngularScan, Pinhole
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import camera

LENS = Pinhole(50.0, 60.0, 7.5, 5.25, PlumbBob(-0.2, 0.05, 0.01, -0.005, 0.002))


def calibrated(**changes) -> CameraInfo:
    """What a driver of a 16 × 12 camera publishes."""
    known = {"height": 12, "width": 16, "distortion_model": "plumb_bob", "d": [-0.2, 0.05, 0.01, -0.005, 0.002],
             "k": np.array([50, 0, 7.5, 0, 60, 5.25, 0, 0, 1.0]), "r": np.eye(3).ravel(), "p": np.eye(3, 4).ravel()}
    return CameraInfo(**(known | changes))


def k(**changes) -> np.ndarray:
    known = {"fx": 50, "skew": 0, "cx": 7.5, "a": 0, "fy": 60, "cy": 5.25, "b": 0, "c": 0, "one": 1} | changes
    return np.array(list(known.values()), np.float64)


def region(left: int, top: int, width: int, height: int) -> RegionOfInterest:
    return RegionOfInterest(x_offset=left, y_offset=top, width=width, height=height)


def test_it_projects_a_point_of_the_sensor_onto_its_pixel(small_sensor):
    sensor = small_sensor.replace(projection=Pinhole(fx=50.0, fy=60.0, cx=1.5, cy=1.0))
    info = camera.camera_info(sensor, 1_500_000_000, "lidar")
    x, y, z = sensor.xyz(np.array([2]), np.array([3]), np.array([40.0]))[0]
    for matrix, point in ((info.k.reshape(3, 3), [x, y, z]), (info.p.reshape(3, 4), [x, y, z, 1])):
        u, v, w = matrix @ point
        np.testing.assert_allclose([u / w, v / w], [3, 2], atol=1e-5)
    assert (info.height, info.width, info.distortion_model, list(info.d)) == (3, 4, "plumb_bob", [0.0] * 5)
    assert (info.r.reshape(3, 3) == np.eye(3)).all() and (info.binning_x, info.roi.width) == (0, 0)
    assert (info.header.stamp.sec, info.header.stamp.nanosec, info.header.frame_id) == (1, 500_000_000, "lidar")


def test_a_lens_is_in_d_and_makes_the_trip(small_sensor):
    info = camera.camera_info(small_sensor.replace(projection=LENS), 0, "lidar")
    assert list(info.d) == [-0.2, 0.05, 0.01, -0.005, 0.002]
    back = deserialize_message(serialize_message(info), CameraInfo)
    assert camera.decode_camera_info(back) == (3, 4, LENS)
    scanner = small_sensor.replace(projection=AngularScan(0.1, -0.01, 0.2, -0.01))
    assert camera.camera_info(scanner, 0, "lidar") is None


@pytest.mark.parametrize(("changes", "distortion"), [
    ({"binning_x": 1, "binning_y": 0}, LENS.distortion), ({"d": []}, PlumbBob()),
    ({"distortion_model": "", "d": [0.0] * 8}, PlumbBob()),
    ({"d": [0.1, 0.2, 0.01, 0.02]}, PlumbBob(0.1, 0.2, 0.01, 0.02))])
def test_what_a_driver_publishes_is_read(changes, distortion):
    assert camera.decode_camera_info(calibrated(**changes)) == (12, 16, Pinhole(50.0, 60.0, 7.5, 5.25, distortion))


def test_a_region_shows_the_pixels_that_lie_in_it():
    rows, cols, lens = camera.decode_camera_info(calibrated(roi=region(5, 2, 8, 6)))
    assert (rows, cols) == (6, 8)
    np.testing.assert_allclose(lens.rays(rows, cols), LENS.rays(12, 16)[2:8, 5:13], atol=1e-6)
    assert camera.decode_camera_info(calibrated(roi=region(15, 11, 1, 1)))[:2] == (1, 1)


@pytest.mark.parametrize(("roi", "left", "top", "rows", "cols"), [
    (region(0, 0, 0, 0), 0, 0, 4, 8), (region(4, 3, 8, 6), 4, 3, 2, 4), (region(4, 3, 9, 7), 4, 3, 2, 4)])
def test_a_binned_pixel_looks_where_the_middle_of_its_pixels_does(roi, left, top, rows, cols):
    found_rows, found_cols, lens = camera.decode_camera_info(calibrated(binning_x=2, binning_y=3, roi=roi))
    assert (found_rows, found_cols) == (rows, cols)
    plane = LENS.rays(12, 16)[top:top + 3 * rows, left:left + 2 * cols]
    plane = (plane[..., :2] / plane[..., 2:]).reshape(rows, 3, cols, 2, 2).mean(axis=(1, 3))
    rays = lens.rays(rows, cols)
    np.testing.assert_allclose(rays[..., :2] / rays[..., 2:], plane, atol=2e-4)


@pytest.mark.parametrize(("changes", "field", "says"), [
    ({"k": np.zeros(9)}, "k", "all 0: expected a calibrated camera"),
    ({"k": k(cx=np.inf)}, "k", "inf"), ({"k": k(fx=-50)}, "k", "above 0"), ({"k": k(skew=1)}, "k", "fx 0 cx"),
    ({"distortion_model": "equidistant", "d": [0.0] * 4}, "distortion_model", "plumb_bob"),
    ({"distortion_model": ""}, "distortion_model", "empty"),
    ({"d": [0.1] * 3}, "d", "3 coefficients"), ({"height": 0}, "height", "0"), ({"width": 2**32 - 1}, "width", "42949"),
    ({"width": 65_536, "height": 65_536}, "width × height", "65536 × 65536: expected at most 16777216 pixels"),
    ({"roi": region(10, 0, 7, 12)}, "roi.width", "7 from pixel 10 on"),
    ({"roi": region(1, 0, 0, 0)}, "roi.width", "0 from"),
    ({"binning_x": 17}, "binning_x", "17"), ({"d": [np.nan, 0, 0, 0, 0]}, "projection.distortion.k1", "nan"),
    ({"d": [-90.0, 0, 0, 0, 0]}, "projection.distortion", "k1 -90")])
def test_a_camera_that_cannot_be_used_is_named_in_one_line(changes, field, says):
    with pytest.raises(InvalidInput) as caught:
        camera.decode_camera_info(calibrated(**changes))
    assert caught.value.field in (f"camera_info.{field}", field) and says in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_the_border_of_a_wide_camera_takes_little_room():
    tracemalloc.start()
    camera.decode_camera_info(calibrated(width=65_536, height=256, k=k(fx=40_000, fy=40_000, cx=32_768, cy=128)))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 30_000_000


small = st.integers(0, 20) | st.integers(0, 2**32 - 1)
number = st.floats(-100, 100) | st.floats()


@settings(max_examples=100, deadline=None)
@given(size=st.tuples(small, small), roi=st.tuples(small, small, small, small), binning=st.tuples(small, small),
       d=st.lists(number, max_size=6),
       changed=st.dictionaries(st.sampled_from(["fx", "fy", "cx", "cy", "one"]), number))
def test_any_camera_is_read_or_refused_but_nothing_else(size, roi, binning, d, changed):
    info = calibrated(height=size[0], width=size[1], roi=region(*roi), binning_x=binning[0], binning_y=binning[1], d=d,
                      k=k(**changed))
    try:
        rows, cols, lens = camera.decode_camera_info(info)
    except InvalidInput as error:
        assert len(str(error).splitlines()) == 1
    else:
        assert 1 <= rows <= size[0] and 1 <= cols <= size[1] and lens.fx > 0
