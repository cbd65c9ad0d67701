"""Growth with the photons: every line is drawn."""

import numpy as np
import pytest
from PIL import Image

from srt3d_ros.pictures.growth import COLOURS, draw_growth


def coloured(path, colour: str) -> np.ndarray:
    """Where a picture has nearly this colour."""
    picture = np.asarray(Image.open(path).convert("RGB")).astype(int)
    return (np.abs(picture - list(bytes.fromhex(colour[1:]))) < 12).all(axis=2)


def line(method, ppp, ms, **figures):
    return {"method": method, "ppp": ppp, "ms": {"min": 0.8 * ms, "median": ms, "max": 1.3 * ms}, **figures}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.png"


def test_time_and_memory_have_a_line_for_each_method(path):
    lines = [line("rt3d", ppp, 50 * ppp, input_bytes=100_000 * ppp, growth_bytes=10**7) for ppp in (1, 10, 100)]
    lines += [line("pooled", ppp, 40, input_bytes=10**6, growth_bytes=5 * 10**6) for ppp in (1, 10, 100)]
    draw_growth(path, lines, "a$b_{", (7, "the paper: 7 ms"), {})
    for method in ("rt3d", "pooled"):
        seen = coloured(path, COLOURS[method])
        half = seen.shape[1] // 2
        assert seen[:, :half].sum() > 300 and seen[:, half:].sum() > 300
    with_goal = coloured(path, "#6b7280").sum()
    draw_growth(path, lines, "", None, {"rt3d": "over 60 s"})
    assert with_goal > coloured(path, "#6b7280").sum() + 50 and not coloured(path, COLOURS["smle"]).any()


def test_a_line_may_end_early_and_memory_may_be_unknown(path):
    lines = [line("rt3d", 1, 50), line("pooled", 1, 40, input_bytes=9), line("pooled", 10, 40)]
    draw_growth(path, lines, "", None, {"rt3d": "over 60 s"})
    seen = coloured(path, COLOURS["rt3d"])
    assert seen[:, :seen.shape[1] // 2].any() and not seen[:, seen.shape[1] // 2:].any()
