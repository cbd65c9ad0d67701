"""The part bytes: the error that counts, the table, the picture; tests/cli/test_benchmark.py measures it."""


from PIL import Image

from srt3d_ros.benchmark import bytes as equal_bytes
from srt3d_ros.benchmark.representations import OURS


def line(name, bytes_per_pixel, error, case="a", how="pooled"):
    return {"case": case, "representation": name, "reconstruction": how, "bytes_per_pixel": bytes_per_pixel,
            "error_bins": error, "true_detections_percent": 99.0, "false_detections_percent": 1.0, "dae_bins": error,
            "photons_per_pixel": 7.0}


def test_a_missed_surface_counts_as_the_tolerance(monkeypatch):
    found = {"true_detections_percent": 75.0, "false_detections_percent": 3.0, "dae_bins": 2.0}
    monkeypatch.setattr(equal_bytes, "judge", lambda *_: found)
    case = type("Case", (), {"tolerance_bins": 10.0})
    assert equal_bytes._errors(None, case, None)["error_bins"] == 0.75 * 2 + 0.25 * 10
    found |= {"true_detections_percent": 0.0, "dae_bins": float("nan")}
    nothing = equal_bytes._errors(None, case, None)
    assert nothing["error_bins"] == 10 and nothing["dae_bins"] is None


def test_a_budget_takes_the_best_that_it_holds():
    lines = [line(OURS, 9, 2.0), line(OURS, 15, 1.0), line("photons", 30, 0.5), line("photons", 8, 2.02)]
    found = equal_bytes.best(lines)
    assert [found["a", OURS, "pooled", budget]["bytes_per_pixel"] for budget in equal_bytes.BUDGETS] == [9, 15, 15, 15]
    text = equal_bytes.table(lines)
    assert "10 bytes a pixel: the coded sketch leads or is level within 2 % in 1 of 1 cases." in text
    assert "in 0 of 1 cases; behind in a (photons 0.5, ours 1)." in text
    assert "| photons " in text and "| 2.02; 99.0 / 1.0 / 2.02 |" in text and "| 0.50 " in text


def test_the_picture_has_a_panel_for_each_case(tmp_path):
    lines = [line(name, size, 10 / size, case) for name in (OURS, "photons") for size in (5, 20) for case in "abcde"]
    equal_bytes.draw(tmp_path / "a.png", lines)
    picture = Image.open(tmp_path / "a.png")
    assert picture.width == 1620 and picture.height == 800
