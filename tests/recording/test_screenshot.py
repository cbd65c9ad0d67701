"""Pictures by the rerun viewer: from the given eye, in the given size."""

import tempfile

import numpy as np
import pytest

from srt3d_ros.core.viewpoint import Viewpoint
from srt3d_ros.recording import screenshot

WIDTH, HEIGHT = 480, 300
EYE = Viewpoint(np.array([0, 0, -5.0]), np.zeros(3), np.array([0, -1.0, 0]), screenshot.FOV_DEG)


def test_points_are_where_the_eye_sees_them_in_the_size_asked_for_and_the_viewer_leaves_nothing(tmp_path, monkeypatch):
    """Two clouds seen along z: a red square in the upper left quarter, and a green one in the lower right."""
    if not screenshot.is_possible():
        pytest.skip("no Vulkan driver: the rerun viewer cannot run without a screen")
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)          # read again
    half_height = np.tan(np.radians(screenshot.FOV_DEG) / 2) * 5        # of the view, at the target
    side = np.linspace(0.2, 0.6, 60) * half_height
    x, y = (values.ravel() for values in np.meshgrid(side, side))
    clouds = [(np.stack([sign * x, sign * y, 0 * x], axis=1), np.tile(np.uint8(colour), (len(x), 1)))
              for sign, colour in ((-1, (255, 0, 0)), (1, (0, 255, 0)))]
    pictures = screenshot.screenshots(clouds, 0.05, EYE, WIDTH, HEIGHT)
    assert not list(tmp_path.iterdir())
    for picture, channel, sign in zip(pictures, (0, 1), (-1, 1)):
        assert picture.shape == (HEIGHT, WIDTH, 3)
        assert np.delete(picture, channel, axis=2)[8:-8, 8:-8].max() < 60       # no words, buttons or notes: grey
        rows, cols = np.nonzero(picture[..., channel] > 100)
        place = HEIGHT / 2 * sign * np.array([0.2, 0.6])
        for found, middle in ((rows, HEIGHT / 2), (cols, WIDTH / 2)):
            assert np.allclose(np.percentile(found, (1, 99)), sorted(middle + place), atol=5)
        assert len(rows) > 0.8 * (0.2 * HEIGHT)**2


def test_a_viewer_that_ends_at_once_is_reported_in_one_line(monkeypatch, tmp_path):
    stub = tmp_path / "rerun"
    stub.write_text("#!/bin/sh\necho 'No graphics adapter was found' >&2\nexit 1\n")
    stub.chmod(0o755)
    monkeypatch.setattr(screenshot.rerun_cli, "__file__", str(tmp_path / "__init__.py"))
    cloud = np.zeros((1, 3)), np.zeros((1, 3), np.uint8)
    with pytest.raises(screenshot.ScreenshotError, match="did not start: No graphics adapter was found"):
        screenshot.screenshots([cloud], 0.05, EYE, WIDTH, HEIGHT)
