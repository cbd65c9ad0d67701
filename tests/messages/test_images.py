"""Images of one number a pixel, and the camera beside them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra import numpy as arrays

from srt3d_ros.core.projection import AngularScan, Pinhole
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import images
from srt3d_ros.messages.header import Header


@settings(max_examples=100, deadline=None)
@given(image=arrays.arrays(np.float32, arrays.array_shapes(min_dims=2, max_dims=2)))
def test_any_image_makes_the_trip(image):
    for header, back in (images.decode_cdr(images.encode_cdr(image, 7, "cam")),
                         images.decode(images.encode(image, 7, "cam"))):
        assert header == Header(7, "cam")
        assert back.shape == image.shape and back.tobytes() == image.tobytes() and back.flags.writeable


def test_image_that_is_not_contiguous_is_written_right():
    image = np.arange(12, dtype=np.float32).reshape(3, 4)
    assert (images.decode(images.encode(image[:, ::2], 0, ""))[1] == image[:, ::2]).all()


@pytest.mark.parametrize("image", [np.zeros((2, 3)), np.zeros((2, 3, 1), np.float32)])
def test_other_types_and_shapes_are_refused(image):
    with pytest.raises(InvalidInput, match=r"^image is float.*: expected float32 \[rows, cols\]"):
        images.encode(image, 0, "lidar")


def test_camera_info_projects_a_point_of_the_sensor_onto_its_pixel(small_sensor):
    sensor = small_sensor.replace(projection=Pinhole(fx=50.0, fy=60.0, cx=1.5, cy=1.0))
    info = images.camera_info(sensor, 1_500_000_000, "lidar")
    x, y, z = sensor.xyz(np.array([2]), np.array([3]), np.array([40.0]))[0]
    for matrix, point in ((info.k.reshape(3, 3), [x, y, z]), (info.p.reshape(3, 4), [x, y, z, 1])):
        u, v, w = matrix @ point
        np.testing.assert_allclose([u / w, v / w], [3, 2], atol=1e-5)
    assert (info.height, info.width, info.distortion_model, list(info.d)) == (3, 4, "plumb_bob", [0.0] * 5)
    assert (info.r.reshape(3, 3) == np.eye(3)).all()
    assert (info.header.stamp.sec, info.header.stamp.nanosec, info.header.frame_id) == (1, 500_000_000, "lidar")


def test_scanner_has_no_camera_info(small_sensor):
    assert images.camera_info(small_sensor.replace(projection=AngularScan(0.1, -0.01, 0.2, -0.01)), 0, "lidar") is None
