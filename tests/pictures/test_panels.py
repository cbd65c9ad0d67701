"""Reconstructions side by side: an image for each cloud, errors in colour, what is missing in black or grey."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from srt3d_ros.pictures.panels import Panel, Strip, draw_clouds, draw_errors

SIDE, LEFT, TOP, ROW, GAP = 240, 14, 84, 318, 8      # of the images, picture elements


def image(path, row: int, column: int) -> np.ndarray:
    """One of a picture's images, int [SIDE, SIDE, 3]."""
    picture = np.asarray(Image.open(path).convert("RGB")).astype(int)
    top, left = TOP + row * ROW, LEFT + column * (SIDE + GAP)
    return picture[top:top + SIDE, left:left + SIDE]


@pytest.fixture
def strip(ball):
    """The ball, and half of it, 5 mm too far above and 5 mm too near below, with a pixel of unknown truth."""
    cloud, sensor = ball
    half = cloud.col < 24
    fields = ("row", "col", "depth_bins", "intensity", "depth_std_bins", "xyz", "surface")
    part = replace(cloud, **{name: getattr(cloud, name)[half] for name in fields})
    error_mm = np.where(np.arange(40)[:, None] < 20, 5.0, -5.0) + np.zeros(48)
    error_mm[:, 24:] = np.nan
    known = np.ones((40, 48), bool)
    known[:, :6] = False
    return Strip("SBR 1", sensor, [Panel("truth", cloud, "all"), Panel("ours", part, "half", error_mm)], known)


def test_clouds_stand_beside_the_truth_in_the_same_colours_and_place(strip, tmp_path):
    draw_clouds(tmp_path / "a.png", [strip, strip], "a$b_{")
    for row in range(2):
        truth, ours = (image(tmp_path / "a.png", row, column) for column in range(2))
        shown = ours.max(axis=2) > 60
        assert 0.1 < shown.mean() < 0.8 * (truth.max(axis=2) > 60).mean()
        assert (np.abs(ours - truth).max(axis=2)[shown] < 60).mean() > 0.7


def test_errors_are_red_where_too_far_and_blue_where_too_near(strip, tmp_path):
    draw_errors(tmp_path / "a.png", [strip], "errors")
    shown = image(tmp_path / "a.png", 0, 0)         # the truth has none
    far, near = shown[45, 70], shown[195, 70]
    assert far[0] > far[2] + 30 and near[2] > near[0] + 30
    assert shown[120, 180].max() < 20               # black: no point
    unknown = shown[120, 10]
    assert np.ptp(unknown) < 12 and 150 < unknown[0] < 210


def test_without_any_truth_there_is_no_map_of_errors(strip, tmp_path):
    draw_errors(tmp_path / "a.png", [replace(strip, panels=strip.panels[:1], known=None)], "errors")
    assert not (tmp_path / "a.png").exists()


def test_empty_clouds_and_errors_of_nothing_are_drawn(strip, tmp_path):
    fields = ("row", "col", "depth_bins", "intensity", "depth_std_bins", "xyz", "surface")
    cloud = strip.panels[0].cloud
    empty = replace(cloud, **{name: getattr(cloud, name)[:0] for name in fields})
    nothing = replace(strip, panels=[Panel("none", empty, "", np.full((40, 48), np.nan))])
    draw_clouds(tmp_path / "a.png", [nothing], "")
    draw_errors(tmp_path / "b.png", [nothing], "")
    assert image(tmp_path / "b.png", 0, 0)[120, 180].max() < 20
