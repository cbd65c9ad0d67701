"""`srt3d inspect`: one pixel in figures and as a picture."""

import json

import numpy as np
import pytest
from PIL import Image


@pytest.fixture
def cube(tmp_path):
    """Two surfaces at 2.25 and 4.5 m with 300 and 100 photons in each of 6 × 8 pixels, 0.1 background photons a bin."""
    rng, irf = np.random.default_rng(0), np.array([1, 4, 6, 4, 1])
    rate = np.full(400, 0.1)
    for depth, photons in ((150, 300), (300, 100)):
        rate[depth - 2:depth + 3] += photons * irf / 16
    np.savez(tmp_path / "two.npz", counts=rng.poisson(rate, (6, 8, 400)), irf=irf, bin_width_s=1e-10, fov_deg=10.0)
    return tmp_path / "two.npz"


def test_the_points_of_the_pixel_are_told_and_drawn(srt3d, cube, tmp_path):
    code, printed, _ = srt3d("inspect", cube, "--pixel", "2,3", "--surfaces", 2, "-o", tmp_path / "a.png", "--json")
    facts = json.loads(printed)
    assert (code, facts["pixel"]) == (0, [2, 3])
    assert [point["range_m"] for point in facts["points"]] == pytest.approx([2.248, 4.497], abs=0.01)
    assert [point["intensity"] for point in facts["points"]] == pytest.approx([300, 100], rel=0.2)
    assert facts["background"] == pytest.approx(40, rel=0.3) and facts["photons"] > 300
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.width > 1000 and len(picture.convert("RGB").getcolors(10**6)) > 20
    code, words, _ = srt3d("inspect", cube, "--pixel", "2,3", "-o", tmp_path / "b.png", "--gate", "250-350")
    assert code == 0 and "4.49" in words and words.count("signal photons") == 1 and "±" in words
    code, words, _ = srt3d("inspect", cube, "--pixel", "2,3", "-o", tmp_path / "c.png", "--method", "xcorr")
    assert code == 0 and "2.2" in words and "±" not in words


@pytest.mark.parametrize("options, expected", [
    (("--pixel", "6,0", "-o", "a.png"), "--pixel is 6,0: expected row below 6 and column below 8"),
    (("--pixel", "-1", "-o", "a.png"), "--pixel is -1: expected row and column from 0, such as 12,40"),
    (("--pixel", "1,1", "-o", "a.pdf"), "--output is a.pdf: expected a name that ends in .png")])
def test_what_cannot_be_used_is_one_line(refusal, cube, monkeypatch, tmp_path, options, expected):
    monkeypatch.chdir(tmp_path)
    assert expected in refusal("inspect", cube, *options)
