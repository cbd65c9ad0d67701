"""Clouds as pictures: the eye, positions, occlusion, shading, and points that cannot be drawn."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.projection import AngularScan, Pinhole
from srt3d_ros.pictures.cloud_renderer import draw_fog, draw_surface, project
from srt3d_ros.pictures.colours import BACKGROUND
from srt3d_ros.pictures.viewpoint import Viewpoint, look_at, point_radius_m, sensor_axes

EYE = Viewpoint(np.zeros(3), np.array([0.0, 0, 2]), np.array([0.0, -1, 0]), 53.13)      # 2 m wide at 2 m
RED, BLUE = (200, 0, 0), (0, 0, 200)


def surface(xyz, colour, radius_m=0.05, finer=1):
    return draw_surface(np.array(xyz, np.float32), np.array(colour, np.uint8), EYE, 120, 100, radius_m, finer)


def plane(z, colour, x_from=-2.0):
    x, y = np.meshgrid(np.arange(x_from, 2, 0.02), np.arange(-1.5, 1.5, 0.02))
    xyz = np.stack([x, y, np.full_like(x, z)], axis=-1).reshape(-1, 3)
    return xyz, np.tile(np.array(colour, np.uint8), (len(xyz), 1))


def test_points_appear_where_they_are_and_the_nearer_hides_the_farther():
    x, y, depth = project(np.array([[0, 0, 2], [1, 0, 2], [0, 1, 2], [0.5, 0, 1]]), EYE, 120, 100)
    assert np.allclose(x, [60, 110, 60, 110], atol=0.01) and np.allclose(y, [50, 50, 100, 50], atol=0.01)
    assert np.allclose(depth, [2, 2, 2, 1])
    points, colours = np.array([[0, 0, 1.0], [0, 0, 2]]), np.array([RED, BLUE])
    for order in ([0, 1], [1, 0]):
        image = surface(points[order], colours[order], radius_m=0.1)
        assert tuple(image[50, 60]) == RED and not (image[..., 2] > BACKGROUND[2]).any()


def test_a_point_is_a_disc_of_its_size_in_its_colour():
    image = surface([[0.2, 0, 2]], [RED], radius_m=0.2)
    covered = image[..., 0] > BACKGROUND[0]
    assert covered.sum() == pytest.approx(np.pi * 10**2, rel=0.05)
    rows, cols = np.nonzero(covered)
    assert (rows.mean() + 0.5, cols.mean() + 0.5) == pytest.approx((50, 70), abs=0.5)
    assert set(map(tuple, image[covered])) == {RED}
    smooth = surface([[0.2, 0, 2]], [RED], radius_m=0.2, finer=2)       # the same, but for its edge
    assert smooth.shape == image.shape and smooth.mean() == pytest.approx(image.mean(), rel=0.02)
    assert len(np.unique(smooth)) > 2


def test_points_behind_the_eye_far_aside_or_missing_are_left_out():
    nowhere = [[0, 0, -1], [0, 0, 0], [500, 0, 1], [np.nan, 0, 2], [0, 0, np.inf]]
    nothing = np.empty((0, 3))
    for image in (surface(nowhere, [RED] * 5), surface(nothing, nothing), draw_fog(nothing, nothing, EYE, 12, 10, 1)):
        assert (image == BACKGROUND).all()


def test_a_plane_is_even_and_only_the_foot_of_a_step_is_darkened():
    far, near = plane(2.5, BLUE), plane(2.0, RED, x_from=0)
    image = surface(*(np.concatenate(parts) for parts in zip(far, near))).astype(int)
    row = image[50]
    assert row[20, 2] == 200 and row[100, 0] == 200
    assert row[60, 0] == 200                        # the edge itself stays bright
    assert 60 < row[56, 2] < 170                    # what lies behind it does not


def test_fog_glows_where_many_points_are_and_hides_nothing():
    points = np.array([[0, 0, 2.0]] + [[0.5, 0, 1.5], [0.5 / 0.75, 0, 2.0]] * 3)
    image = draw_fog(points, np.array([RED] + [RED, BLUE] * 3), EYE, 120, 100, 1).astype(int)
    behind = np.array(BACKGROUND)
    assert image[50, 60] == pytest.approx(0.6 * np.array(RED) + 0.4 * behind, abs=1)
    assert image[50, 93] == pytest.approx((1 - 0.4**6) * np.array([100, 0, 100]) + 0.4**6 * behind, abs=1)
    assert (image != BACKGROUND).any(axis=2).sum() == 2


@pytest.fixture
def box():
    """Points evenly in a box 4 m ahead, 1 m wide, 1 m high and 0.5 m deep, in (forward, right, up)."""
    return np.random.default_rng(0).uniform([4, -0.5, -0.5], [4.5, 0.5, 0.5], (5000, 3))


@pytest.mark.parametrize("projection", [None, Pinhole(50, 50, 20, 20), AngularScan(0.4, -0.02, 0.4, -0.02)])
@pytest.mark.parametrize("yaw_deg, pitch_deg", [(30, 20), (-60, 30), (170, -40)])
def test_the_eye_is_upright_where_it_was_asked_for_and_has_the_cloud_in_view(box, projection, yaw_deg, pitch_deg):
    axes, (yaw, pitch) = sensor_axes(projection), np.radians([yaw_deg, pitch_deg])
    eye = look_at(box @ axes, projection, yaw_deg, pitch_deg)
    towards = axes @ (eye.position - eye.target)
    assert np.allclose(towards / np.linalg.norm(towards),
                       [-np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)], atol=0.01)
    right, down, forward = eye.axes()
    assert np.allclose(np.cross(right, down), forward) and abs(right @ axes[2]) < 1e-9 and down @ axes[2] < 0
    seen = (box @ axes - eye.position) @ eye.axes().T
    half = np.tan(np.radians(eye.fov_deg) / 2)
    assert (seen[:, 2] > 0).all() and (np.abs(seen[:, :2]) < half * seen[:, 2:]).mean() > 0.99


def test_outliers_do_not_move_the_eye_and_without_points_it_looks_ahead(box):
    axes = sensor_axes(None)
    spoiled = np.concatenate([box, np.full((20, 3), 1e4), np.full((20, 3), np.nan)])
    there, here = look_at(box @ axes), look_at(spoiled @ axes)
    assert np.linalg.norm(there.position - here.position) < 0.1
    eye = look_at(np.empty((0, 3)))
    assert np.isfinite(eye.position).all() and eye.axes()[2] @ [0, 0, 1] > 0


def test_points_of_neighbouring_pixels_just_touch(ball):
    cloud, sensor = ball
    apart_m = np.linalg.norm(sensor.rays[20, 24] - sensor.rays[20, 25]) * np.median(np.linalg.norm(cloud.xyz, axis=1))
    assert apart_m / 2 < point_radius_m(cloud.xyz, sensor) < apart_m
    assert point_radius_m(cloud.xyz[:0], sensor) == 0
    alone = sensor.replace(rows=1, cols=1, projection=Pinhole(100, 100, 0, 0))
    assert point_radius_m(cloud.xyz, alone) == 0
