"""Rays: unit length, and where row and col point."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.distortion import PlumbBob
from srt3d_ros.core.sensor.projection import AngularScan, Pinhole
from srt3d_ros.errors import InvalidInput
from srt3d_ros.kernels.cpu.sketching.move_sketch import NOWHERE, place


def test_pinhole_looks_along_z_from_its_principal_point_x_to_the_right_y_down():
    rays = Pinhole(30, 40, 3, 1).rays(4, 7)
    np.testing.assert_allclose(rays / rays[..., 2:], np.stack(np.broadcast_arrays(
        (np.arange(7) - 3) / 30, (np.arange(4)[:, None] - 1) / 40, 1), axis=-1), atol=1e-6)


def test_scan_angles_are_azimuth_and_elevation():
    rays = AngularScan(0.5, -0.25, -0.2, 0.1).rays(5, 6).astype(np.float64)
    azimuth, elevation = np.arctan2(rays[..., 1], rays[..., 0]), np.arcsin(rays[..., 2])
    np.testing.assert_allclose(azimuth, np.broadcast_to(0.5 - 0.25 * np.arange(6), (5, 6)), atol=1e-6)
    np.testing.assert_allclose(elevation, np.broadcast_to((-0.2 + 0.1 * np.arange(5))[:, None], (5, 6)), atol=1e-6)


@pytest.mark.parametrize(("name", "value"), [
    ("fx", np.nan), ("cy", np.inf), ("fx", 0), ("fy", -1.5),
    ("fx", 1e-300), ("fy", 1e300), ("cx", 1e300), ("cy", -2e9)])                    # whose squares are no numbers
def test_pinhole_refuses_what_gives_no_rays(name, value):
    with pytest.raises(InvalidInput, match=f"^projection.{name} is"):
        Pinhole(**({"fx": 1, "fy": 1, "cx": 0, "cy": 0} | {name: value}))


@pytest.mark.parametrize("lens", [Pinhole(1e-6, 1e-6, -1e9, 1e9), Pinhole(1e100, 1e100, 0, 0),
                                  AngularScan(1e6, 1e6, -1e6, 1e6)])
def test_the_extremes_have_unit_rays(lens):
    assert lens.rays(3, 40).shape == (3, 40, 3) and lens.rays(3, 40).dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(lens.rays(3, 40), axis=-1), 1, rtol=1e-6)


@pytest.mark.parametrize("name", AngularScan.__dataclass_fields__)
def test_scan_refuses_angles_that_are_not_finite_or_huge(name):
    for value, shown in ((np.nan, "nan"), (1e308, r"1e\+308: expected -1e\+06 to 1e\+06 rad")):
        with pytest.raises(InvalidInput, match=f"^projection.{name} is {shown}"):
            AngularScan(**(dict.fromkeys(AngularScan.__dataclass_fields__, 0.1) | {name: value}))


def test_a_field_of_view_spans_the_larger_side_and_impossible_ones_are_refused():
    lens = Pinhole.from_fov(20, 31, 40)
    assert lens.fx == lens.fy == pytest.approx(31 / 2 / np.tan(np.radians(20)))
    assert (lens.cx, lens.cy) == (15, 9.5)
    for fov_deg in (0, 180, np.nan):
        with pytest.raises(InvalidInput, match="^fov_deg is"):
            Pinhole.from_fov(10, 10, fov_deg)


def coordinates(lens, rows: int, cols: int) -> np.ndarray:
    """What is even over the pixels, [rows, cols, 2]: x/z and y/z of a camera, the angles of a scan."""
    x, y, z = np.moveaxis(lens.rays(rows, cols).astype(np.float64), -1, 0)
    pair = (x / z, y / z) if lens.kind == "pinhole" else (np.arctan2(y, x), np.arcsin(z))
    return np.stack(pair, axis=-1)


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
