"""Clouds taken out of a recording: in every format what was recorded, pixels and bins found again."""

import dataclasses
import sys

import numpy as np
import pytest
from PIL import Image

from srt3d_ros.colours import BACKGROUND
from srt3d_ros.datasets.bag import Bag
from srt3d_ros.errors import InvalidInput
from srt3d_ros.messages import points
from srt3d_ros.review import export

PLACE = 20          # the cloud with all points


def test_npz_holds_the_cloud_as_it_was_reconstructed(recorded, ball, tmp_path):
    cloud, sensor = ball
    export.save_frame(recorded, PLACE, tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as file:
        assert np.array_equal(file["xyz"], cloud.xyz) and np.array_equal(file["intensity"], cloud.intensity)
        for name in ("row", "col"):
            assert np.array_equal(file[name], getattr(cloud, name))
        assert np.allclose(file["depth_bins"], cloud.depth_bins, atol=1e-3)
        assert np.allclose(file["depth_std_bins"], cloud.depth_std_bins, rtol=1e-5)
        assert np.array_equal(file["background"], cloud.background)
        assert file["frequencies"].tolist() == [1, 2, 5] and int(file["num_bins"]) == sensor.num_bins
        assert int(file["stamp_ns"]) == recorded.index.stamp_ns[PLACE]


def test_points_of_a_pixel_are_ranked_whatever_their_order(recorded, ball):
    cloud, sensor = ball
    (frame,) = recorded.reader.clouds({PLACE})
    rng = np.random.default_rng(0)
    order = rng.permutation(len(frame))
    shuffled = type(frame)(frame.stamp_ns, frame.frame_index, frame.xyz[order], rng.permutation(frame.intensity),
                           frame.colour[order])
    found = export.point_cloud(shuffled, sensor)
    assert np.array_equal(np.unique(found.row.astype(int) * 48 + found.col),
                          np.unique(cloud.row.astype(int) * 48 + cloud.col))
    assert (found.surface == 1).sum() == (cloud.surface == 1).sum() > 0
    assert np.isnan(found.depth_std_bins).all() and np.isnan(found.background).all()
    strongest = found.image("intensity")
    assert (strongest[found.row, found.col] >= found.intensity).all()


def test_recorded_ranks_of_a_pixels_points_are_kept(recorded, ball):
    cloud, sensor = ball[0].ordered("farthest"), ball[1]
    (frame,) = recorded.reader.clouds({PLACE})
    order = np.random.default_rng(0).permutation(len(cloud))
    names = ("row", "col", "surface", "xyz", "intensity")
    shuffled = dataclasses.replace(frame, **{name: getattr(cloud, name)[order] for name in names})
    found = export.point_cloud(shuffled, sensor)
    for name in names:
        assert np.array_equal(getattr(found, name), getattr(cloud, name))


def test_a_picture_has_cloud_title_figures_and_scale(recorded, tmp_path, monkeypatch):
    monkeypatch.setattr(export, "_PICTURE_PX", (700, 400))
    export.save_frame(recorded, PLACE, tmp_path / "a.png", "own")
    picture = np.asarray(Image.open(tmp_path / "a.png").convert("L")).astype(int)
    assert picture.shape == (540, 700)
    assert (picture[20:70, 15:500] > 200).sum() > 300            # title
    assert (picture[490:530, 15:300] > 100).sum() > 100          # figures
    assert (picture[465:478, 550:690] > 100).sum() > 30          # scale bar
    assert (picture[90:450] > 60).mean() > 0.2                   # cloud


def test_a_bag_holds_every_cloud_at_its_stamp(recorded, ball, tmp_path):
    assert export.save_bag(recorded, tmp_path / "bag") == len(recorded.index)
    with Bag(tmp_path / "bag") as bag:
        messages = list(bag.messages(bag.topics))
    assert len(messages) == len(recorded.index) and messages[PLACE].topic == "/points"
    header, columns = points.decode_cdr(messages[PLACE].raw)
    assert header.frame_id == "test_lidar" and header.stamp_ns == recorded.index.stamp_ns[PLACE]
    assert np.array_equal(columns["xyz"], ball[0].xyz)


def test_the_film_turns_to_either_side_and_back_and_does_not_flicker(recorded, tmp_path, monkeypatch):
    monkeypatch.setattr(export, "_FILM_PX", (200, 150))
    monkeypatch.setattr(export, "_FILM_FRAMES", 8)
    export.save_turntable(recorded, PLACE, tmp_path / "a.gif")
    pictures = []
    with Image.open(tmp_path / "a.gif") as gif:
        assert gif.n_frames == 8 and gif.info["loop"] == 0
        for k in range(8):
            gif.seek(k)
            pictures.append(np.asarray(gif.convert("RGB")).astype(int))
    start, right, middle, left = pictures[0], pictures[2], pictures[4], pictures[6]
    assert np.abs(start - middle).mean() < 1 and np.abs(right - left).mean() > 4
    for picture in pictures:
        assert 0.05 < (picture.max(axis=2) > 60).mean() < 0.95
        colours, numbers = np.unique(picture.reshape(-1, 3), axis=0, return_counts=True)
        assert tuple(colours[numbers.argmax()]) == BACKGROUND


def test_a_film_as_mp4_says_what_to_install(recorded, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(InvalidInput, match="pip install imageio-ffmpeg"):
        export.save_turntable(recorded, PLACE, tmp_path / "a.mp4")
