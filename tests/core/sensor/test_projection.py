"""Rays: where row and col point, through lenses of any distortion that can be inverted."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srt3d_ros.core.sensor.distortion import PlumbBob
from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sensor.projection import AngularScan, Pinhole
from srt3d_ros.errors import InvalidInput
from srt3d_ros.kernels.cpu.sketching.move_sketch import NOWHERE, place


def test_rays_of_a_camera_start_at_its_principal_point_and_those_of_a_scan_are_angles():
    rays = Pinhole(30, 40, 3, 1).rays(4, 7)
    np.testing.assert_allclose(rays / rays[..., 2:], np.stack(np.broadcast_arrays(
        (np.arange(7) - 3) / 30, (np.arange(4)[:, None] - 1) / 40, 1), axis=-1), atol=1e-6)
    rays = AngularScan(0.5, -0.25, -0.2, 0.1).rays(5, 6).astype(np.float64)
    azimuth, elevation = np.arctan2(rays[..., 1], rays[..., 0]), np.arcsin(rays[..., 2])
    np.testing.assert_allclose(azimuth, np.broadcast_to(0.5 - 0.25 * np.arange(6), (5, 6)), atol=1e-6)
    np.testing.assert_allclose(elevation, np.broadcast_to((-0.2 + 0.1 * np.arange(5))[:, None], (5, 6)), atol=1e-6)


@pytest.mark.parametrize(("part", "values"), [
    (Pinhole(1, 1, 0, 0), {"fx": 0, "fy": -1.5, "cx": 1e300, "cy": -2e9}),     # whose squares are no numbers
    (AngularScan(0, 1, 0, 1), {"azimuth_start_rad": 1e308, "elevation_step_rad": np.nan}),
    (PlumbBob(), {"k1": np.inf, "p2": np.nan}), (GateWords(), {"first_word": -1, "no_detection": 65_536})])
def test_numbers_that_give_no_rays_or_words_are_refused(part, values):
    for name, value in values.items():
        with pytest.raises(InvalidInput, match=rf"{name} is {re.escape(str(value))}: expected "):
            replace(part, **{name: value})


@pytest.mark.parametrize("lens", [Pinhole(1e-6, 1e-6, -1e9, 1e9), Pinhole(1e100, 1e100, 0, 0),
                                  AngularScan(1e6, 1e6, -1e6, 1e6)])
def test_the_extremes_have_unit_rays(lens):
    assert lens.rays(3, 40).shape == (3, 40, 3) and lens.rays(3, 40).dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(lens.rays(3, 40), axis=-1), 1, rtol=1e-6)


def test_a_field_of_view_spans_the_larger_side_and_impossible_ones_are_refused():
    lens = Pinhole.from_fov(20, 31, 40)
    assert lens.fx == lens.fy == pytest.approx(31 / 2 / np.tan(np.radians(20)))
    assert (lens.cx, lens.cy) == (15, 9.5)
    for fov_deg in (0, 180, np.nan):
        with pytest.raises(InvalidInput, match="^fov_deg is"):
            Pinhole.from_fov(10, 10, fov_deg)


LENSES = [Pinhole(30, 40, 3.2, 1.1), Pinhole(300, 310, 5, 3, PlumbBob(-0.3, 0.1, 1e-3, -2e-3, -0.02)),
          AngularScan(0.5, -0.25, -0.2, 0.1), AngularScan(-3, 2 * np.pi / 9, 0.3, -0.1)]


@pytest.mark.parametrize("lens", LENSES)
def test_points_on_a_pixels_ray_are_seen_at_its_place(lens):
    for at in np.ndindex(6, 9):
        np.testing.assert_allclose(place(*lens.rays(6, 9)[at] * np.float32(3.7), tuple(lens.lens)), at, atol=1e-3)


def test_a_camera_sees_nothing_behind_it_or_where_its_lens_model_turns_back():
    lens = Pinhole(100, 100, 50, 50, PlumbBob(k1=-0.3))
    assert lens.distortion.reach == pytest.approx(1 / 0.9)
    for xyz, seen in (((0.1, 0, -1), False), ((1.2, 0, 1), False), ((0, 0, 0), False), ((1, 0, 1), True)):
        assert (place(*np.float32(xyz), tuple(lens.lens))[0] != NOWHERE) == seen
    assert PlumbBob(k1=0.1).reach == np.inf == PlumbBob().reach


ROWS, COLS = 24, 32


def seen_at(lens: Pinhole, rays: np.ndarray) -> np.ndarray:
    """(col, row) at which points on these rays appear, [rows, cols, 2], as OpenCV's projectPoints says."""
    x, y = np.moveaxis(rays[..., :2].astype(np.float64) / rays[..., 2:], -1, 0)
    d, r = lens.distortion, np.hypot(x, y)
    gain = 1 + d.k1 * r**2 + d.k2 * r**4 + d.k3 * r**6
    bent_x = x * gain + 2 * d.p1 * x * y + d.p2 * (r**2 + 2 * x**2)
    bent_y = y * gain + d.p1 * (r**2 + 2 * y**2) + 2 * d.p2 * x * y
    return np.stack([lens.fx * bent_x + lens.cx, lens.fy * bent_y + lens.cy], axis=-1)


def pixels(rows: int, cols: int) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(cols), np.arange(rows)), axis=-1)


def test_a_wide_lens_of_a_real_camera():
    """A barrel of 100° across the corners."""
    lens = Pinhole(458.65, 457.3, 367.2, 248.4, PlumbBob(-0.2834, 0.07396, 0.00019, 0.000018))
    rays = lens.rays(480, 752)
    np.testing.assert_allclose(seen_at(lens, rays), pixels(480, 752), atol=1e-3)
    straight = Pinhole(458.65, 457.3, 367.2, 248.4).rays(480, 752)
    assert np.abs(rays - straight).max() > 0.05 and np.abs(rays - straight)[248, 367].max() < 1e-5


@pytest.mark.parametrize("lens", [
    Pinhole(20, 20, 15.5, 11.5, PlumbBob(k1=-0.5)),                     # turns back at r = 0.82, x' = 0.54
    Pinhole(20, 20, 15.5, 11.5, PlumbBob(k1=-0.8, k2=-0.6, k3=0.68)),   # turns back, and forth again
    Pinhole(8, 8, 15.5, 11.5, PlumbBob(k1=-1, k2=-1, k3=0.7)),          # the same, seen by no pixel at the border
    Pinhole(20, 20, 15.5, 11.5, PlumbBob(p1=0.4, p2=0.4)),
    Pinhole(20, 20, 15.5, 11.5, PlumbBob(1e300, 1e300, 1e300, -1e300, 1e300)),
    Pinhole(1e-3, 1e-3, 15.5, 11.5, PlumbBob(k3=-1e-3)),
], ids=["one fold", "two folds", "two folds inside", "tangential", "huge", "short focal length"])
def test_a_model_that_folds_inside_the_image_is_refused_in_one_line(lens):
    one_line = "^projection.distortion is k1 .*: expected a model that shows one ray at each pixel; this .*$"
    with pytest.raises(InvalidInput, match=one_line):
        SensorModel(ROWS, COLS, 50, 1e-10, np.ones(3), projection=lens)


@settings(max_examples=100, deadline=None)
@given(coefficients=st.tuples(*map(st.floats, (-2, -2, -0.1, -0.1, -2), (2, 2, 0.1, 0.1, 2))),
       focal=st.floats(5, 100), centre=st.floats(-40, 70))
def test_any_model_is_inverted_or_refused(coefficients, focal, centre):
    lens = Pinhole(focal, focal, centre, 11.5, PlumbBob(*coefficients))
    try:
        rays = SensorModel(ROWS, COLS, 50, 1e-10, np.ones(3), projection=lens).rays
    except InvalidInput as error:
        assert error.field == "projection.distortion" and len(str(error).splitlines()) == 1
    else:
        np.testing.assert_allclose(seen_at(lens, rays), pixels(ROWS, COLS), atol=1e-3)
        turned = np.cross(np.gradient(rays, axis=1), np.gradient(rays, axis=0))
        assert ((turned * rays).sum(axis=-1) > 0).all()         # neighbours stay neighbours: nothing is folded over
