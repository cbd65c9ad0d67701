"""Curves: every line is drawn, and what is missing is left out."""

import numpy as np
import pytest
from PIL import Image

from srt3d_ros.pictures.curves import GROWTH_STYLES, METHOD_COLOURS, draw_calibration, draw_growth, draw_metrics


def row(method, size, sbr, ppp, **figures):
    known = {"true_detections_percent": 90.0, "false_detections_percent": 3.0, "dae_mm": 2.0, "iae": 0.2}
    return {"method": method, "sketch_size": size, "sbr": str(sbr), "ppp": str(ppp)} | known | figures


def line(method, ppp, ms, **figures):
    return {"method": method, "ppp": ppp, "ms": {"min": 0.8 * ms, "median": ms, "max": 1.3 * ms}, **figures}


def coloured(path, colour: str) -> np.ndarray:
    """Where a picture has nearly this colour."""
    picture = np.asarray(Image.open(path).convert("RGB")).astype(int)
    return (np.abs(picture - list(bytes.fromhex(colour[1:]))) < 12).all(axis=2)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.png"


def test_each_method_has_a_line_in_each_column(path):
    rows = [row(method, size, sbr, ppp, dae_mm=height * ppp ** -0.5, true_detections_percent=20.0 * height)
            for sbr in (10, 1) for ppp in (1, 10, 100)
            for height, (method, size) in enumerate((("ours", "5"), ("ours", "10"), ("other", "")), start=1)]
    draw_metrics(path, rows, "a$b_{", ["ours", "other"])
    for colour in METHOD_COLOURS[:2]:
        seen = coloured(path, colour)
        half = seen.shape[1] // 2
        assert seen[:, :half].sum() > 300 and seen[:, half:].sum() > 300
    assert not coloured(path, METHOD_COLOURS[2]).any()


def test_calibration_shows_a_line_for_each_setting_in_its_panel(path):
    nominal = (0.1, 0.5, 0.9)
    draw_calibration(path, {"SBR 1": {"1 ppp": (10, 50, 90), "10 ppp": (5, 30, 70)}, "SBR 10": {"1 ppp": (1, 2, 3)}},
                     nominal, {0.5: (0.4, 0.6)}, "calibration")
    picture = np.asarray(Image.open(path).convert("RGB"))
    assert picture.shape[1] > 1.5 * picture.shape[0]
    assert coloured(path, "#003373").sum() > 200 and coloured(path, "#b8bec6").sum() > 200


def test_time_and_memory_have_a_line_for_each_method(path):
    lines = [line("rt3d", ppp, 50 * ppp, input_bytes=100_000 * ppp, growth_bytes=10**7) for ppp in (1, 10, 100)]
    lines += [line("pooled", ppp, 40, input_bytes=10**6, growth_bytes=5 * 10**6) for ppp in (1, 10, 100)]
    draw_growth(path, lines, "a$b_{", (7, "the paper: 7 ms"), {})
    for method in ("rt3d", "pooled"):
        seen = coloured(path, GROWTH_STYLES[method][0])
        half = seen.shape[1] // 2
        assert seen[:, :half].sum() > 300 and seen[:, half:].sum() > 300
    with_goal = coloured(path, "#6b7280").sum()
    draw_growth(path, lines, "", None, {"rt3d": "over 60 s"})
    assert with_goal > coloured(path, "#6b7280").sum() + 50 and not coloured(path, GROWTH_STYLES["smle"][0]).any()


def test_a_line_may_end_early_and_memory_may_be_unknown(path):
    lines = [line("rt3d", 1, 50), line("pooled", 1, 40, input_bytes=9), line("pooled", 10, 40)]
    draw_growth(path, lines, "", None, {"rt3d": "over 60 s"})
    seen = coloured(path, GROWTH_STYLES["rt3d"][0])
    assert seen[:, :seen.shape[1] // 2].any() and not seen[:, seen.shape[1] // 2:].any()
