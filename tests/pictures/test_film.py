"""The film of a turning cloud: it moves, comes back, and does not flicker."""

import importlib.util

import numpy as np
import pytest
from PIL import Image

from srt3d_ros.errors import InvalidInput
from srt3d_ros.pictures import film
from srt3d_ros.pictures.cloud_renderer import BACKGROUND, CloudStyle

FRAMES = 8


@pytest.fixture(scope="module")
def pictures(tmp_path_factory, ball):
    """The film's pictures as arrays, and whether it is shown again and again."""
    cloud, sensor = ball
    path = tmp_path_factory.mktemp("film") / "a.gif"
    film.save_turntable(path, cloud, CloudStyle.of(cloud, sensor), sensor.projection, (200, 150), FRAMES)
    gif = Image.open(path)
    assert gif.n_frames == FRAMES and gif.info["loop"] == 0
    found = []
    for k in range(FRAMES):
        gif.seek(k)
        found.append(np.asarray(gif.convert("RGB")).astype(int))
    return found


def test_it_shows_the_cloud_turning_to_either_side_and_back(pictures):
    start, right, middle, left = pictures[0], pictures[2], pictures[4], pictures[6]
    assert np.abs(start - middle).mean() < 1 and np.abs(right - left).mean() > 4
    assert all(0.05 < (picture.max(axis=2) > 60).mean() < 0.95 for picture in pictures)


def test_its_background_stays_the_same(pictures):
    for picture in pictures:
        colours, numbers = np.unique(picture.reshape(-1, 3), axis=0, return_counts=True)
        assert tuple(colours[numbers.argmax()]) == BACKGROUND


def test_mp4_says_what_to_install(tmp_path, ball):
    if importlib.util.find_spec("imageio_ffmpeg") is not None:
        pytest.skip("imageio-ffmpeg is installed")
    with pytest.raises(InvalidInput, match="pip install imageio-ffmpeg"):
        film.save_turntable(tmp_path / "a.mp4", ball[0], CloudStyle(1, 2, 0.01), None, (64, 48), 2)
