"""Cloud: its images, limits and the order of a pixel's points."""

from dataclasses import replace

import numpy as np
import pytest

from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SPEED_OF_LIGHT, SensorModel
from srt3d_ros.core.sensor.projection import AngularScan, Pinhole
from srt3d_ros.errors import InvalidInput

NAN = np.nan
METRES = SensorModel(2, 3, 100, 2 / SPEED_OF_LIGHT, [1.0])      # a bin is a metre


def seen_by(projection, cloud: PointCloud) -> PointCloud:
    return replace(cloud, sensor=cloud.sensor.replace(projection=projection))


@pytest.fixture
def two_in_one_pixel() -> PointCloud:
    """Of 2 × 3 pixels (0, 1) has two points, (1, 2) one."""
    return PointCloud(row=np.array([0, 0, 1], np.uint16), col=np.array([1, 1, 2], np.uint16),
                 depth_bins=np.array([2, 6, 5], np.float32), intensity=np.array([5, 2, 4], np.float32),
                 depth_std_bins=np.array([0.5, 1, 0.25], np.float32),
                 xyz=np.array([[0, 0, 2], [0, 0, 6], [0, 3, 4]], np.float32),
                 surface=np.array([0, 1, 0], np.uint8), background=np.zeros((2, 3), np.float32),
                 stamp_ns=9, sensor=METRES)


@pytest.mark.parametrize(("image", "expected"), [
    (lambda cloud: cloud.image("depth_bins"), [[NAN, 2, NAN], [NAN, NAN, 5]]),
    (lambda cloud: cloud.image("depth_std_bins"), [[NAN, 0.5, NAN], [NAN, NAN, 0.25]]),
    (lambda cloud: cloud.image("depth_bins", surface=1), [[NAN, 6, NAN], [NAN] * 3]),
    (lambda cloud: cloud.range_image(), [[NAN, 2, NAN], [NAN, NAN, 5]]),
    (lambda cloud: seen_by(Pinhole(10, 10, 1, 0.5), cloud).depth_image(), [[NAN, 2, NAN], [NAN, NAN, 4]]),
    (lambda cloud: seen_by(AngularScan(0, 0.1, 0, 0.1), cloud).depth_image(), [[NAN, 2, NAN], [NAN, NAN, 5]])])
def test_images_show_the_first_points_and_nan_elsewhere(two_in_one_pixel, image, expected):
    shown = image(two_in_one_pixel)
    assert shown.dtype == np.float32
    np.testing.assert_array_equal(shown, expected)


def test_limits_are_ranges_along_the_ray_and_further_surfaces_keep_their_order(two_in_one_pixel):
    assert two_in_one_pixel.within() is two_in_one_pixel
    assert len(two_in_one_pixel.within(2, 6)) == 3
    kept = two_in_one_pixel.within(min_m=4.5)
    assert kept.xyz.tolist() == [[0, 0, 6], [0, 3, 4]] and kept.stamp_ns == 9
    assert kept.intensity.tolist() == [2, 4] and kept.depth_bins.tolist() == [6, 5]
    assert kept.depth_std_bins.tolist() == [1, 0.25]
    assert len(two_in_one_pixel.within(max_m=1)) == 0
    np.testing.assert_array_equal(kept.range_image(), [[NAN, 6, NAN], [NAN, NAN, 5]])       # the first that is left
    assert kept.ordered("nearest") is kept
    row, col = np.array([0, 0, 0, 0, 1], np.uint16), np.array([0, 2, 2, 2, 0], np.uint16)
    ones = np.ones(5, np.float32)
    cloud = PointCloud(row, col, np.array([1, 9, 2, 3, 1], np.float32), ones, ones, np.zeros((5, 3), np.float32),
                  np.array([0, 0, 1, 2, 0], np.uint8), np.zeros((2, 3), np.float32), sensor=METRES)
    kept = cloud.within(max_m=5)
    assert kept.depth_bins.tolist() == [1, 2, 3, 1] and kept.surface.tolist() == [0, 0, 1, 0]


@pytest.mark.parametrize(("surface_order", "depth", "intensity"), [
    ("strongest", [7, 40, 10, 40, 90, 90, 20], [1, 9, 5, 2, 8, 6, 3]),
    ("nearest", [7, 10, 40, 40, 20, 90, 90], [1, 5, 9, 2, 3, 8, 6]),
    ("farthest", [7, 40, 40, 10, 90, 90, 20], [1, 9, 2, 5, 8, 6, 3])])
def test_the_points_of_a_pixel_come_in_the_order_asked_for_and_ties_keep_theirs(surface_order, depth, intensity):
    row, col = np.array([0, 0, 0, 0, 1, 1, 1], np.uint16), np.array([1, 2, 2, 2, 0, 0, 0], np.uint16)
    by_strength = np.float32([[7, 40, 10, 40, 90, 90, 20], [1, 9, 5, 2, 8, 6, 3]])
    cloud = PointCloud(row, col, *by_strength, by_strength[1] / 10, np.repeat(by_strength[0][:, None], 3, axis=1),
                  np.array([0, 0, 1, 2, 0, 1, 2], np.uint8), np.zeros((2, 3), np.float32), stamp_ns=9,
                  sensor=METRES)
    ordered = cloud.ordered(surface_order)
    assert ordered.depth_bins.tolist() == ordered.xyz[:, 2].tolist() == depth
    assert ordered.intensity.tolist() == intensity
    assert (ordered.depth_std_bins == ordered.intensity / 10).all() and ordered.stamp_ns == 9
    for name in ("row", "col", "surface"):
        assert getattr(ordered, name).tolist() == getattr(cloud, name).tolist()
    assert ordered.ordered("strongest").intensity.tolist() == cloud.intensity.tolist()
    with pytest.raises(InvalidInput, match="^surface_order is first: expected strongest or nearest or farthest$"):
        cloud.ordered("first")
