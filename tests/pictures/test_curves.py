"""Curves: every line is drawn, and what is missing is left out."""

import numpy as np
import pytest
from PIL import Image

from srt3d_ros.pictures.curves import GROWTH_STYLES, METHOD_COLOURS, draw_calibration, draw_growth, draw_metrics


def line(method, ppp, ms, **figures):
    return {"method": method, "ppp": ppp, "ms": {"min": 0.8 * ms, "median": ms, "max": 1.3 * ms}, **figures}


def coloured(path, colour: str) -> np.ndarray:
    """How many picture elements of the left and of the right half have nearly this colour."""
    picture = np.asarray(Image.open(path).convert("RGB")).astype(int)
    seen = (np.abs(picture - list(bytes.fromhex(colour[1:]))) < 12).all(axis=2)
    return np.array([half.sum() for half in np.array_split(seen, 2, axis=1)])


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.png"


def test_each_method_has_a_line_in_each_column(path):
    rows = [{"method": method, "sketch_size": size, "sbr": str(sbr), "ppp": str(ppp), "dae_mm": height * ppp ** -0.5,
             "true_detections_percent": 20.0 * height, "false_detections_percent": 3.0, "iae": 0.2}
            for sbr in (10, 1) for ppp in (1, 10, 100)
            for height, (method, size) in enumerate((("ours", "5"), ("ours", "10"), ("other", "")), start=1)]
    draw_metrics(path, rows, "a$b_{", ["ours", "other"])
    for colour in METHOD_COLOURS[:2]:
        assert (coloured(path, colour) > 300).all()
    assert not coloured(path, METHOD_COLOURS[2]).any()


def test_calibration_shows_a_line_for_each_setting_in_its_panel(path):
    draw_calibration(path, {"SBR 1": {"1 ppp": (10, 50, 90), "10 ppp": (5, 30, 70)}, "SBR 10": {"1 ppp": (1, 2, 3)}},
                     (0.1, 0.5, 0.9), {0.5: (0.4, 0.6)}, "calibration")
    width, height = Image.open(path).size
    assert width > 1.5 * height
    assert coloured(path, "#003373").sum() > 200 and coloured(path, "#b8bec6").sum() > 200


def test_time_and_memory_have_a_line_for_each_method_as_far_as_they_are_known(path):
    lines = [line("rt3d", ppp, 50 * ppp, input_bytes=100_000 * ppp, growth_bytes=10**7) for ppp in (1, 10, 100)]
    lines += [line("pooled", ppp, 40, input_bytes=10**6, growth_bytes=5 * 10**6) for ppp in (1, 10, 100)]
    lines += [line("smle", ppp, 5 * ppp) for ppp in (1, 3)]
    draw_growth(path, lines, "a$b_{", (7, "the paper: 7 ms"), {"smle": "over 60 s"})
    for method in ("rt3d", "pooled"):
        assert (coloured(path, GROWTH_STYLES[method][0]) > 300).all()
    time, memory = coloured(path, GROWTH_STYLES["smle"][0])
    assert time and not memory
    assert coloured(path, "#6b7280")[0] > 50                            # the goal
