"""The eye: on the side of the sensor, upright, everything in view."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.projection import AngularScan, Pinhole
from srt3d_ros.pictures.viewpoint import look_at, point_radius_m, sensor_axes

PROJECTIONS = [None, Pinhole(50, 50, 20, 20), AngularScan(0.4, -0.02, 0.4, -0.02)]


@pytest.fixture
def box():
    """Points evenly in a box 4 m ahead, 1 m wide, 1 m high and 0.5 m deep, in (forward, right, up)."""
    return np.random.default_rng(0).uniform([4, -0.5, -0.5], [4.5, 0.5, 0.5], (5000, 3))


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_eye_is_on_the_sensor_s_side_right_and_above_when_asked(box, projection):
    axes = sensor_axes(projection)
    eye = look_at(box @ axes, projection, yaw_deg=30, pitch_deg=20)
    forward, right, up = axes @ (eye.position - eye.target)
    assert forward < 0 < right and up > 0
    assert np.allclose(axes @ eye.target, [4.25, 0, 0], atol=0.05)


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("yaw_deg, pitch_deg", [(0, 0), (-60, 30), (170, -40)])
def test_axes_are_upright_and_the_cloud_is_in_view(box, projection, yaw_deg, pitch_deg):
    axes = sensor_axes(projection)
    eye = look_at(box @ axes, projection, yaw_deg, pitch_deg)
    right, down, forward = eye.axes()
    assert np.allclose(np.cross(right, down), forward) and abs(right @ axes[2]) < 1e-9 and down @ axes[2] < 0
    seen = (box @ axes - eye.position) @ eye.axes().T
    half = np.tan(np.radians(eye.fov_deg) / 2)
    assert (seen[:, 2] > 0).all() and (np.abs(seen[:, :2]) < half * seen[:, 2:]).mean() > 0.99


def test_outliers_and_missing_points_do_not_move_the_eye(box):
    axes = sensor_axes(None)
    spoiled = np.concatenate([box, np.full((20, 3), 1e4), np.full((20, 3), np.nan)])
    there, here = look_at(box @ axes), look_at(spoiled @ axes)
    assert np.linalg.norm(there.position - here.position) < 0.1


def test_an_empty_cloud_gives_an_eye_that_looks_ahead():
    eye = look_at(np.empty((0, 3)))
    assert np.isfinite(eye.position).all() and eye.axes()[2] @ [0, 0, 1] > 0


def test_points_of_neighbouring_pixels_just_touch(ball):
    cloud, sensor = ball
    apart_m = np.linalg.norm(sensor.rays[20, 24] - sensor.rays[20, 25]) * np.median(np.linalg.norm(cloud.xyz, axis=1))
    assert apart_m / 2 < point_radius_m(cloud.xyz, sensor) < apart_m
    assert point_radius_m(cloud.xyz[:0], sensor) == 0
    alone = sensor.replace(rows=1, cols=1, projection=Pinhole(100, 100, 0, 0))
    assert point_radius_m(cloud.xyz, alone) == 0
