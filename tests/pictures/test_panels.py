"""Reconstructions side by side: an image for each cloud."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from srt3d_ros.pictures import panels
from srt3d_ros.pictures.panels import Panel, Strip, draw_clouds


@pytest.fixture
def images(monkeypatch, tmp_path):
    """Draw, and return the images in the picture, float [rows, cols, 3] from 0 to 255."""
    def call(strips):
        figures = []
        monkeypatch.setattr(panels, "save_png", lambda figure, path: figures.append(figure))
        draw_clouds(tmp_path / "a.png", strips, "a$b_{")
        return [axes.images[0].get_array().astype(float) for figure in figures for axes in figure.axes if axes.images]
    return call


@pytest.fixture
def strip(ball):
    """The ball, and half of it."""
    cloud, sensor = ball
    fields = ("row", "col", "depth_bins", "intensity", "depth_std_bins", "xyz", "surface")
    part = replace(cloud, **{name: getattr(cloud, name)[cloud.col < 24] for name in fields})
    return Strip("SBR 1", sensor, [Panel("truth", cloud, "all"), Panel("ours", part, "half")])


def test_clouds_stand_beside_the_truth_in_the_same_colours_and_place(strip, images):
    shown = images([strip, strip])
    assert len(shown) == 4
    for truth, ours in (shown[:2], shown[2:]):
        points = ours.max(axis=2) > 60
        assert 0.1 < points.mean() < 0.8 * (truth.max(axis=2) > 60).mean()
        assert (np.abs(ours - truth).max(axis=2)[points] < 60).mean() > 0.7


def test_an_empty_cloud_is_drawn(strip, tmp_path):
    empty = strip.panels[0].cloud.within(max_m=0)
    draw_clouds(tmp_path / "empty.png", [strip._replace(panels=[Panel("none", empty, "")])], "")
    with Image.open(tmp_path / "empty.png") as picture:
        assert picture.width > picture.height > 300
