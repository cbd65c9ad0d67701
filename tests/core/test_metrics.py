"""Clouds: their images, limits and the order of a pixel's points; TD, FD and DAE of some that are counted by hand."""

from dataclasses import replace

import numpy as np
import pytest

from srt3d_ros.core.metrics import evaluate
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SPEED_OF_LIGHT, SensorModel
from srt3d_ros.core.sensor.projection import AngularScan, Pinhole
from srt3d_ros.errors import InvalidInput

T = 100
NAN = np.nan


METRES = SensorModel(2, 3, T, 2 / SPEED_OF_LIGHT, [1.0])        # a bin is a metre


def cloud(*points: tuple, surface=0, stamp_ns: int = 0) -> PointCloud:
    """Points (row, col, depth[, intensity[, standard deviation]]) of an image."""
    full = np.array([(*point, *(1.0, 1.0)[len(point) - 3:]) for point in points]).reshape(-1, 5)
    row, col, depth, intensity, std = full.astype(np.float32).T
    xyz = depth[:, None] * np.float32([0, 0, 1])
    return PointCloud(row.astype(np.uint16), col.astype(np.uint16), depth, intensity, std, xyz,
                      np.broadcast_to(np.uint8(surface), len(points)), np.zeros((2, 3), np.float32), stamp_ns=stamp_ns,
                      sensor=METRES)


def test_points_within_the_tolerance_are_true_also_round_the_period_and_the_others_false():
    reference = [[10, 20, 30], [40, 50, 60]]
    found = evaluate(cloud((0, 0, 12), (0, 1, 17), (0, 2, 34), (1, 0, 40)), reference, 3, T)
    assert found.true_detections == 3 / 6 and found.false_detections == 1 / 6 and found.points == 4
    assert found.dae_bins == pytest.approx((2 + 3 + 0) / 3)          # the tolerance itself is within
    assert evaluate(cloud((0, 0, 12.01)), np.full((2, 3), 10.0), 2, T).true_detections == 0
    found = evaluate(cloud((0, 0, 99), (0, 1, 1)), [[1, 98, NAN], [NAN, NAN, NAN]], 3, T)
    assert (found.true_detections, found.false_detections) == (1, 0) and found.dae_bins == pytest.approx(2.5)


def test_points_where_there_is_known_to_be_nothing_are_false():
    points = cloud((0, 0, 10), (1, 1, 77, 2.0))
    found = evaluate(points, [[10, NAN, 30], [NAN] * 3], 3, T, [[1.0, NAN, 1], [NAN] * 3], complete=True)
    assert (found.true_detections, found.false_detections) == (1 / 2, 1 / 2) and found.iae == (1 + 2) / 2
    assert found.within_1_std == 1                                              # its error is none


def test_several_surfaces_are_each_counted():
    reference = np.full((2, 2, 3), NAN)
    reference[0] = 10
    reference[1, 0, 0] = 50
    points = (0, 0, 51), (0, 0, 11), (0, 1, 12), (0, 1, 52), (0, 2, 50)
    found = evaluate(cloud(*points), reference, 3, T)
    assert found.true_detections == 3 / 7            # both of (0, 0), one of (0, 1)
    assert found.false_detections == 2 / 7           # the second of (0, 1), and (0, 2)
    assert found.dae_bins == pytest.approx((1 + 1 + 2) / 3)


@pytest.mark.parametrize(("points", "reference"), [
    ([], np.full((2, 3), 10.0)), ([], np.full((2, 2, 3), NAN)), ([(0, 0, 10)], np.full((2, 3), NAN))])
def test_without_points_or_references_nothing_is_found(points, reference):
    found = evaluate(cloud(*points), reference, 3, T)
    assert (found.true_detections, found.false_detections, found.points) == (0, 0, len(points))
    assert np.isnan(found.dae_bins) and np.isnan(found.iae)


# ---- Intensity

def test_intensities_that_match_nothing_count_in_full():
    depth, photons = [[10, 20, NAN], [NAN] * 3], [[8.0, 4, NAN], [NAN] * 3]
    right, missed_and_false, second = (0, 0, 11, 6.0), (0, 1, 70, 3.0), (0, 0, 13, 2.0)
    assert evaluate(cloud(right, (0, 1, 20, 4)), depth, 3, T, photons).iae == pytest.approx(2 / 12)
    assert evaluate(cloud(right), depth, 3, T, photons).iae == pytest.approx((2 + 4) / 12)
    assert evaluate(cloud(right, missed_and_false), depth, 3, T, photons).iae == pytest.approx((2 + 4 + 3) / 12)
    assert evaluate(cloud(right, second), depth, 3, T, photons).iae == pytest.approx((2 + 4 + 2) / 12)
    assert evaluate(cloud(right, (1, 1, 70, 9.0)), depth, 3, T, photons).iae == pytest.approx((2 + 4) / 12)


@pytest.mark.parametrize(("changes", "named"), [
    *(({"reference_depth_bins": np.ones(shape)}, "reference shape") for shape in ((3, 2), (6,), (1, 1, 2, 3))),
    ({"reference_intensity": np.ones((2, 2, 3))}, "intensity shape")])
def test_maps_of_another_shape_are_refused(changes, named):
    with pytest.raises(InvalidInput, match=f"^{named} is .*: expected "):
        evaluate(**({"cloud": cloud(), "reference_depth_bins": np.zeros((2, 3)), "tolerance_bins": 3, "num_bins": T}
                    | changes))


# ---- Reported standard deviations

def test_shares_of_errors_within_their_standard_deviations():
    reference = [[10, 10, 10], [10, NAN, NAN]]
    points = (0, 0, 12, 1, 2.0), (0, 1, 7, 1, 2.0), (0, 2, 10, 1, 0.5), (1, 0, 90, 1, 3.0), (1, 1, 10, 1, 1.0)
    found = evaluate(cloud(*points), reference, 3, T)
    assert (found.within_1_std, found.within_2_std) == (2 / 4, 3 / 4)           # far ones count as well
    reference = np.full((2, 3), 10.0)
    assert evaluate(cloud((0, 0, 10, 1, 0.0), (0, 1, 11, 1, 2.0)), reference, 3, T).within_1_std == 1
    assert np.isnan(evaluate(cloud((0, 0, 10, 1, NAN)), reference, 3, T).within_1_std)


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
    kept = cloud((0, 0, 1), (0, 2, 9), (0, 2, 2), (0, 2, 3), (1, 0, 1), surface=[0, 0, 1, 2, 0]).within(max_m=5)
    assert kept.depth_bins.tolist() == [1, 2, 3, 1] and kept.surface.tolist() == [0, 0, 1, 0]
