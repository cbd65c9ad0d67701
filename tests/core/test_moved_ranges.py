"""Ranges of the last cloud's surfaces, seen from where the sensor is by now."""

import numpy as np
import pytest

from srt3d_ros.core.deskew import moved_ranges
from srt3d_ros.core.motion import Pose
from srt3d_ros.core.projection import AngularScan, Pinhole
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import InvalidInput

SENSOR = SensorModel(24, 32, 300, 1e-10, np.ones(5), projection=Pinhole.from_fov(24, 32, 30.0))
SCANNER = SENSOR.replace(projection=AngularScan(-0.2, 0.01, -0.1, 0.01))
AHEAD = Pose(translation=np.array([0, 0, -0.5]))        # of what stands still, while the sensor moves 0.5 m forward


def test_a_wall_comes_nearer_and_what_is_behind_the_border_is_unknown():
    wall = np.full((24, 32), 3.0, np.float32)
    wall[:, 0] = np.nan
    moved = moved_ranges(wall, SENSOR, AHEAD)
    known = np.isfinite(moved)
    place = np.float32(2.5) / SENSOR.rays[..., 2]
    # a point may lie half a pixel beside the ray that it stands for
    np.testing.assert_allclose(moved[known], place[known], rtol=4e-3)
    assert known[4:20, 4:28].mean() > 0.6


def test_of_two_surfaces_the_nearer_one_is_seen():
    step = np.full((24, 32), 4.0, np.float32)
    step[:, 16:] = 2.0
    aside = Pose(translation=np.array([-0.1, 0, 0]))    # the sensor moves 0.1 m to the right: the near one hides more
    moved = moved_ranges(step, SENSOR, aside)
    near = np.nanmax(np.where(moved[12] < 3, np.arange(32), -1)), np.nanmin(np.where(moved[12] < 3, np.arange(32), 99))
    assert near[1] < 15 and not np.any(moved[:, near[1] + 1:near[0] - 1] > 3)


def test_a_scanners_image_holds_ranges_and_a_turn_moves_columns():
    image = np.tile(np.linspace(2, 3, 32, dtype=np.float32), (24, 1))
    moved = moved_ranges(image, SCANNER, Pose.turned([0, 0, 0.05]))       # by five columns
    np.testing.assert_allclose(moved[2:-2, 7:-2], image[2:-2, 2:-7], atol=0.04)


def test_zeros_are_no_surface_and_another_size_is_refused():
    assert np.isnan(moved_ranges(np.zeros((24, 32), np.float32), SENSOR, AHEAD)).all()
    for shape in ((24, 64), (23, 32), (12, 16)):
        with pytest.raises(InvalidInput, match="depth image is .* expected 24 × 32 pixels"):
            moved_ranges(np.ones(shape, np.float32), SENSOR, AHEAD)
