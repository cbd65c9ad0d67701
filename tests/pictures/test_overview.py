"""The overview picture: every panel is filled, whatever the cloud lacks."""

import numpy as np
import pytest
from PIL import Image

from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.pictures.overview import draw_overview

PHOTONS, CLOUD, DEPTH_MAP = slice(60, 580), slice(640, 1360), slice(1430, 1880)      # columns of the panels


@pytest.fixture
def drawn(tmp_path, ball):
    """Draw the ball or its photons alone, and give the picture at half its size as an array int [rows, cols, 3]."""
    cloud, sensor = ball
    pixel = (cloud.row.astype(np.uint32) * sensor.cols + cloud.col).repeat(10)
    toa = np.clip(cloud.depth_bins.repeat(10) + np.random.default_rng(0).normal(0, 8, len(pixel)), 0, 599)
    photons = PhotonEvents(pixel, toa.astype(np.uint16))

    def draw(title, figures, with_photons=True, max_m=9):
        path = tmp_path / "a.png"
        draw_overview(path, cloud.within(max_m=max_m), photons if with_photons else None, title, figures)
        return np.asarray(Image.open(path).convert("RGB").reduce(2)).astype(int)
    return draw


def filled(picture, columns):
    """Share of a panel that is lighter than the background."""
    return (picture[200:700, columns].max(axis=2) > 50).mean()


def test_near_is_yellow_and_far_is_blue_in_cloud_and_depth_map(drawn):
    picture = drawn("A ball", {"points": 19_871}, with_photons=False)
    size = 540 / 48                                     # of a pixel in the depth map, whose middle is at (499, 1690)
    ball_front, wall, hole = picture[499, int(1690 - 8 * size)], picture[499 - int(18 * size), 1690], picture[499, 1690]
    assert min(ball_front[:2]) > ball_front[2] + 60     # yellow
    assert wall[2] > wall[0] + 30 and hole[2] > hole[0] + 30        # blue; the ball has a hole in its middle
    cloud = picture[200:700, 60:1360].reshape(-1, 3)        # it takes the photons' panel, too
    assert (cloud[:, :2].min(axis=1) > cloud[:, 2] + 60).mean() > 0.1 and (cloud[:, 2] > cloud[:, 0] + 30).mean() > 0.1


def test_all_panels_show_something_and_long_texts_are_taken_literally(drawn):
    picture = drawn("a$b$_{x} \\frac " + "very " * 60 + "long", {f"figure {k}": k / 7 for k in range(30)})
    assert picture.shape == (900, 2000, 3)
    assert min(filled(picture, CLOUD), filled(picture, DEPTH_MAP)) > 0.5 and 0.02 < filled(picture, PHOTONS) < 0.7
    for text in (picture[30:80], picture[840:880]):
        assert (text[:, 30:600].max(axis=2) > 100).any() and (text[:, 1990:].max(axis=2) < 50).all()
    empty = drawn("nothing", {}, max_m=0)
    assert 0 < filled(empty, CLOUD) < 0.02 and filled(empty, PHOTONS) > 0.001        # the words, and photons
