"""The part bytes: every representation on a tiny frame, its table, its picture, and where ours leads or not."""

import dataclasses

import numpy as np
from PIL import Image

from srt3d_ros.benchmark import bytes as equal_bytes
from srt3d_ros.benchmark.representations import OURS, REPRESENTATIONS
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets import npz
from srt3d_ros.datasets.scene import StaticScene
from srt3d_ros.datasets.simulator import Simulator


def line(name, bytes_per_pixel, error, case="a", how="pooled"):
    return {"case": case, "representation": name, "reconstruction": how, "bytes_per_pixel": bytes_per_pixel,
            "error_bins": error, "true_detections_percent": 99.0, "false_detections_percent": 1.0, "dae_bins": error,
            "photons_per_pixel": 7.0}


def test_every_representation_is_measured_on_simulated_frames_and_files(tiny, bar, tmp_path):
    sensor = SensorModel(8, 9, 100, 1e-10, np.hanning(9)[1:-1])
    depth = np.full((8, 9), 40.0)
    frame, truth = Simulator(StaticScene(sensor.range_m(depth)), sensor, sbr=5, ppp=20, seed=1).frame(0)
    npz.save(tmp_path / "wall.npz", sensor, frame, reference_depth_bins=truth)
    npz.save(tmp_path / "unknown.npz", sensor, frame)
    plan = dataclasses.replace(tiny, lights=((1, 20),), every_size=8, tolerance="5",
                               photons=(str(tmp_path / "wall.npz"), str(tmp_path / "unknown.npz")))
    lines = list(equal_bytes.measure(plan, bar))
    assert {(one["case"], one["representation"]) for one in lines} == {
        (case, name) for case in ("bust, SBR 1, 20 ppp", "wall") for name in REPRESENTATIONS}
    assert any("unknown: left out: it has no reference" in text for text in bar.notes)
    of_wall = [one for one in lines if one["case"] == "wall"]
    assert {one["tolerance_bins"] for one in of_wall} == {5}
    ours = min(one["error_bins"] for one in of_wall if one["representation"] == OURS)
    assert ours < 0.5
    text = equal_bytes.table(lines)
    assert "wall: error, bins" in text and text.count("bytes a pixel: the coded sketch leads") == 4


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
