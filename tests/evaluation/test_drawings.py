"""Reconstructions side by side: an image for each cloud."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from srt3d_ros.core.point_cloud import POINT_FIELDS
from srt3d_ros.evaluation.drawings import draw_row


@pytest.fixture
def images():
    """Draw a row of clouds; its images, float [rows, cols, 3] from 0 to 255."""
    def call(*clouds):
        figure = Figure().subfigures(1, 1)
        draw_row(figure, 3, [("a$b_{", cloud, "caption") for cloud in clouds])
        return [axes.images[0].get_array().astype(float) for axes in figure.axes if axes.images]
    return call


def test_clouds_stand_beside_the_truth_in_the_same_colours_and_place(ball, images):
    truth, _ = ball
    part = replace(truth, **{name: getattr(truth, name)[truth.col < 24] for name in POINT_FIELDS})
    whole, half = images(truth, part)
    points = half.max(axis=2) > 60
    assert 0.1 < points.mean() < 0.8 * (whole.max(axis=2) > 60).mean()
    assert (np.abs(half - whole).max(axis=2)[points] < 60).mean() > 0.7


def test_an_empty_cloud_is_drawn(ball, images):
    empty, = images(ball[0].within(max_m=0))
    assert (empty.max(axis=2) < 60).all()
