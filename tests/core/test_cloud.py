"""PointCloud: its images."""

import numpy as np
import pytest

from srt3d_ros.core.cloud import PointCloud

NAN = np.nan


@pytest.fixture
def two_in_one_pixel() -> PointCloud:
    """Of 2 × 3 pixels (0, 1) has two points, (1, 2) one."""
    return PointCloud(row=np.array([0, 0, 1], np.uint16), col=np.array([1, 1, 2], np.uint16),
                      depth_bins=np.array([10, 30, 20], np.float32), intensity=np.array([5, 2, 4], np.float32),
                      depth_std_bins=np.array([0.5, 1, 0.25], np.float32),
                      xyz=np.array([[0, 0, 2], [0, 0, 6], [0, 3, 4]], np.float32),
                      surface=np.array([0, 1, 0], np.uint8), background=np.zeros((2, 3), np.float32), stamp_ns=9)


def test_its_length_is_its_points(two_in_one_pixel):
    assert len(two_in_one_pixel) == 3


@pytest.mark.parametrize(("field", "expected"), [
    ("depth_bins", [[NAN, 10, NAN], [NAN, NAN, 20]]), ("intensity", [[NAN, 5, NAN], [NAN, NAN, 4]]),
    ("depth_std_bins", [[NAN, 0.5, NAN], [NAN, NAN, 0.25]])])
def test_images_show_the_strongest_points_and_nan_elsewhere(two_in_one_pixel, field, expected):
    image = two_in_one_pixel.image(field)
    assert image.dtype == np.float32
    np.testing.assert_array_equal(image, expected)


def test_images_of_the_second_surface(two_in_one_pixel):
    np.testing.assert_array_equal(two_in_one_pixel.image("depth_bins", surface=1), [[NAN, 30, NAN], [NAN] * 3])
    assert np.isnan(two_in_one_pixel.image("depth_bins", surface=2)).all()


def test_range_is_the_distance_of_the_strongest_point(two_in_one_pixel):
    image = two_in_one_pixel.range_image()
    assert image.dtype == np.float32
    np.testing.assert_array_equal(image, [[NAN, 2, NAN], [NAN, NAN, 5]])
