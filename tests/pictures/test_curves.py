"""Curves: every line is drawn, and what is missing is left out."""

import numpy as np
import pytest
from PIL import Image

from srt3d_ros.pictures.curves import METHOD_COLOURS, draw_metrics


def coloured(path, colour: str) -> np.ndarray:
    """How many picture elements of the left and of the right half have nearly this colour."""
    picture = np.asarray(Image.open(path).convert("RGB")).astype(int)
    seen = (np.abs(picture - list(bytes.fromhex(colour[1:]))) < 12).all(axis=2)
    return np.array([half.sum() for half in np.array_split(seen, 2, axis=1)])


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.png"


def test_each_method_has_a_line_in_each_column(path):
    rows = [{"method": method, "sketch_size": size, "sbr": sbr, "ppp": ppp, "dae_mm": height * ppp ** -0.5,
             "true_detections_percent": 20.0 * height, "false_detections_percent": 3.0, "iae": 0.2}
            for sbr in (10, 1) for ppp in (1, 10, 100)
            for height, (method, size) in enumerate((("ours", 5), ("ours", 10), ("other", None)), start=1)]
    draw_metrics(path, rows, "a$b_{", ["ours", "other"])
    for colour in METHOD_COLOURS[:2]:
        assert (coloured(path, colour) > 300).all()
    assert not coloured(path, METHOD_COLOURS[2]).any()
