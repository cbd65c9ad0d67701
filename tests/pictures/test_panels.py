"""Reconstructions side by side: an image for each cloud, errors in colour, what is missing in black or grey."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from srt3d_ros.pictures import panels
from srt3d_ros.pictures.panels import Panel, Strip, draw_clouds, draw_errors


@pytest.fixture
def images(monkeypatch, tmp_path):
    """Draw, and return the images in the picture, float [rows, cols, 3] from 0 to 255."""
    def call(draw, strips):
        figures = []
        monkeypatch.setattr(panels, "save_png", lambda figure, path: figures.append(figure))
        draw(tmp_path / "a.png", strips, "a$b_{")
        shown = [axes.images[0].get_array() for figure in figures for axes in figure.axes if axes.images]
        return [image * (255 if image.dtype.kind == "f" else 1.0) for image in shown]
    return call


@pytest.fixture
def strip(ball):
    """The ball, and half of it, 5 mm too far above and 5 mm too near below, with a pixel of unknown truth."""
    cloud, sensor = ball
    fields = ("row", "col", "depth_bins", "intensity", "depth_std_bins", "xyz", "surface")
    part = replace(cloud, **{name: getattr(cloud, name)[cloud.col < 24] for name in fields})
    error_mm = np.where(np.arange(40)[:, None] < 20, 5.0, -5.0) + np.zeros(48)
    error_mm[:, 24:] = np.nan
    known = np.ones((40, 48), bool)
    known[:, :6] = False
    return Strip("SBR 1", sensor, [Panel("truth", cloud, "all"), Panel("ours", part, "half", error_mm)], known)


def test_clouds_stand_beside_the_truth_in_the_same_colours_and_place(strip, images):
    shown = images(draw_clouds, [strip, strip])
    assert len(shown) == 4
    for truth, ours in (shown[:2], shown[2:]):
        points = ours.max(axis=2) > 60
        assert 0.1 < points.mean() < 0.8 * (truth.max(axis=2) > 60).mean()
        assert (np.abs(ours - truth).max(axis=2)[points] < 60).mean() > 0.7


def test_errors_are_red_where_too_far_and_blue_where_too_near(strip, images):
    (shown,) = images(draw_errors, [strip, replace(strip, panels=strip.panels[:1], known=None)])   # no error, no map
    far, near = shown[5, 10], shown[35, 10]
    assert far[0] > far[2] + 30 and near[2] > near[0] + 30
    assert shown[20, 30].max() == 0                 # black: no point
    assert np.ptp(shown[20, 2]) == 0 and 150 < shown[20, 2, 0] < 210        # grey: no reference


def test_empty_clouds_and_errors_of_nothing_are_drawn(strip, tmp_path):
    empty = strip.panels[0].cloud.within(max_m=0)
    nothing = replace(strip, panels=[Panel("none", empty, "", np.full((40, 48), np.nan))])
    for draw in (draw_clouds, draw_errors):
        draw(tmp_path / f"{draw.__name__}.png", [nothing], "")
    with Image.open(tmp_path / "draw_errors.png") as picture:
        assert picture.width > picture.height > 300
