"""TD, FD and DAE of clouds small enough to count by hand."""

import numpy as np
import pytest

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.metrics import circular_difference, evaluate
from srt3d_ros.errors import InvalidInput

T = 100
NAN = np.nan


def cloud(*points: tuple[int, int, float], shape=(2, 3)) -> PointCloud:
    """Points (row, col, depth) of an image."""
    row, col, depth = (np.array([point[k] for point in points]) for k in range(3)) if points else np.zeros((3, 0))
    n = len(points)
    return PointCloud(row.astype(np.uint16), col.astype(np.uint16), depth.astype(np.float32), np.ones(n, np.float32),
                      np.ones(n, np.float32), np.zeros((n, 3), np.float32), np.zeros(n, np.uint8),
                      np.zeros(shape, np.float32))


def test_points_within_the_tolerance_are_true_and_the_others_false():
    reference = [[10, 20, 30], [40, 50, 60]]
    found = evaluate(cloud((0, 0, 12), (0, 1, 17), (0, 2, 34), (1, 0, 40)), reference, 3, T)
    assert found.true_detections == 3 / 6 and found.false_detections == 1 / 6 and found.points == 4
    assert found.dae_bins == pytest.approx((2 + 3 + 0) / 3)


def test_the_tolerance_itself_is_within():
    assert evaluate(cloud((0, 0, 12)), np.full((2, 3), 10.0), 2, T).true_detections == 1 / 6
    assert evaluate(cloud((0, 0, 12.01)), np.full((2, 3), 10.0), 2, T).true_detections == 0


def test_depths_wrap_around_the_period():
    found = evaluate(cloud((0, 0, 99), (0, 1, 1)), [[1, 98, NAN], [NAN, NAN, NAN]], 3, T)
    assert (found.true_detections, found.false_detections) == (1, 0) and found.dae_bins == pytest.approx(2.5)


def test_pixels_without_reference_are_not_judged():
    found = evaluate(cloud((0, 0, 10), (1, 1, 77)), [[10, NAN, 30], [NAN, NAN, NAN]], 3, T)
    assert (found.true_detections, found.false_detections, found.points) == (1 / 2, 0, 2)


def test_several_surfaces_are_each_counted():
    reference = np.full((2, 2, 3), NAN)
    reference[0] = 10
    reference[1, 0, 0] = 50
    points = (0, 0, 51), (0, 0, 11), (0, 1, 12), (0, 1, 52), (0, 2, 50)
    found = evaluate(cloud(*points), reference, 3, T)
    assert found.true_detections == 3 / 7            # both of (0, 0), one of (0, 1)
    assert found.false_detections == 2 / 7           # the second of (0, 1), and (0, 2)
    assert found.dae_bins == pytest.approx((1 + 1 + 2) / 3)


def test_of_several_points_at_one_surface_the_nearest_counts():
    found = evaluate(cloud((0, 0, 12), (0, 0, 9)), [[10, NAN, NAN], [NAN, NAN, NAN]], 3, T)
    assert (found.true_detections, found.false_detections, found.dae_bins) == (1, 0, 1)


@pytest.mark.parametrize("reference", [np.full((2, 3), 10.0), np.full((2, 3), NAN), np.full((2, 2, 3), NAN)])
def test_an_empty_cloud_finds_nothing(reference):
    found = evaluate(cloud(), reference, 3, T)
    assert (found.true_detections, found.false_detections, found.points) == (0, 0, 0) and np.isnan(found.dae_bins)


def test_without_any_reference_nothing_is_judged():
    found = evaluate(cloud((0, 0, 10)), np.full((2, 3), NAN), 3, T)
    assert (found.true_detections, found.false_detections) == (0, 0) and np.isnan(found.dae_bins)


@pytest.mark.parametrize("shape", [(3, 2), (6,), (1, 3, 2), (1, 1, 2, 3)])
def test_a_reference_of_another_shape_is_refused(shape):
    with pytest.raises(InvalidInput, match=r"^reference shape is .*: expected \[rows, cols\] = \(2, 3\)"):
        evaluate(cloud(), np.zeros(shape), 3, T)


@pytest.mark.parametrize(("a", "b", "difference"), [(1, 2, -1), (2, 1, 1), (99, 1, -2), (1, 99, 2), (0, 50, -50),
                                                    (50, 0, -50), (99.5, 0, -0.5), (30, 30, 0)])
def test_difference_on_a_circle_is_the_short_way_round(a, b, difference):
    assert circular_difference(np.float64(a), np.float64(b), T) == difference
