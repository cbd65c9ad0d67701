"""`srt3d benchmark`: the parts asked for, to a file and a table; a mistake is one line."""

import json
import subprocess
import sys

import numpy as np
import pytest
import torch

from srt3d_ros.benchmark import command, figure1, sketching, table1
from srt3d_ros.benchmark.plan import PartFailed, Plan
from srt3d_ros.benchmark.representations import OURS, REPRESENTATIONS
from srt3d_ros.cli import main
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets import npz
from srt3d_ros.datasets.scene import StaticScene
from srt3d_ros.datasets.simulator import Simulator

TINY = Plan(repeats=1, sides=(12,), sketch_sizes=(5,), side=12, ppps=(1, 10), dense_ppps=(5,), cycles=40,
            lights=((1, 10),), every_size=8)


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run `srt3d benchmark` with tiny plans; returns exit code, what was printed, and the result lines."""
    monkeypatch.setattr(command, "FULL", TINY)
    monkeypatch.setattr(command, "QUICK", TINY)
    monkeypatch.setattr(command, "machine_slug", lambda device: f"here-{device}")

    def call(*options):
        code = main.main(["benchmark", *options, "--device", "cpu", "--out", str(tmp_path / "out")])
        files = list((tmp_path / "out").glob("*.jsonl"))
        lines = [json.loads(line) for line in files[0].read_text(encoding="utf-8").splitlines()] if files else []
        return code, capsys.readouterr(), lines
    return call


def test_parts_go_to_one_file_and_a_table_each(run, tmp_path):
    code, printed, lines = run("sketching", "table1", "figure1", "--repeats", "2")
    assert code == 0
    assert list(dict.fromkeys(line["part"] for line in lines)) == ["table1", "figure1", "sketching"]
    of = {part: [line for line in lines if line["part"] == part] for part in ("table1", "figure1", "sketching")}
    assert {(line["method"], line["sketch_size"]) for line in of["table1"]} == {("pooled", 5), ("srt3d", 5)}
    assert all(line["growth_bytes"] < line["process_peak_bytes"] for line in of["table1"])
    *of_photons, flatness = of["figure1"]
    assert flatness["what"] == "flatness" and flatness["ppps"] == [1, 10] and flatness["max_over_min"] >= 1
    methods = {*figure1.METHOD_NAMES, "sketching"}
    assert {(line["method"], line["ppp"]) for line in of_photons} == {(m, ppp) for m in methods for ppp in (1, 10)}
    held = {(line["method"], line["ppp"]): line.get("input_bytes") for line in of_photons}
    assert held["rt3d", 10] == 6 * of_photons[-1]["photons"]                    # pixel and time of arrival
    assert held["xcorr", 1] == held["xcorr", 10] == 2 * 12 * 12 * 4613
    assert held["pooled", 1] == held["pooled", 10] == 12 * 12 * (10 * 8 + 4)
    assert [line["form"] for line in of["sketching"]] == list(sketching.FORMS)
    for line in of["sketching"]:
        seconds = line["ms"]["median"] / 1e3
        assert line["photons_per_s"] == pytest.approx(line["photons"] / seconds, rel=0.01)
        gates = line["form"] == "gates"
        assert line.get("readouts_per_s") == (pytest.approx(40 / seconds, rel=0.01) if gates else None)
    assert all(line["repeats"] == 2 for line in lines if line["what"] != "flatness")
    titles = ("Table 1 of the paper", "Figure 1 of the paper", "Sketching")
    assert [printed.out.count(title) for title in titles] == [1, 1, 1] and "| 12² " in printed.out
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"here-cpu.jsonl", "here-cpu-figure1.png"}


def test_bytes_are_a_part_of_their_own_with_a_picture_on_simulated_frames_and_files(run, tmp_path):
    sensor = SensorModel(8, 9, 100, 1e-10, np.hanning(9)[1:-1])
    frame, truth = Simulator(StaticScene(sensor.range_m(np.full((8, 9), 40.0))), sensor, sbr=5, ppp=20, seed=1).frame(0)
    files = [str(tmp_path / name) for name in ("wall.npz", "unknown.npz")]
    npz.save(files[0], sensor, frame, reference_depth_bins=truth)
    npz.save(files[1], sensor, frame)
    code, printed, lines = run("--bytes", *files, "--tolerance", "5", "--quick")
    assert code == 0 and {line["part"] for line in lines} == {"bytes"}
    assert {(line["case"], line["representation"]) for line in lines} == {
        (case, name) for case in ("bust, SBR 1, 10 ppp", "wall") for name in REPRESENTATIONS}
    of_wall = [line for line in lines if line["case"] == "wall"]
    assert {line["tolerance_bins"] for line in of_wall} == {5}
    assert min(line["error_bins"] for line in of_wall if line["representation"] == OURS) < 0.5
    assert "unknown: left out: it has no reference" in printed.err and "wall: error, bins" in printed.out
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"here-cpu-quick.jsonl", "here-cpu-quick-bytes.png"}
    code, printed, _ = run("--bytes", str(tmp_path / "none.npz"))
    assert code == 2 and "none.npz" in printed.err.splitlines()[-1] and "Traceback" not in printed.err


def test_an_interruption_of_a_quick_look_keeps_and_shows_what_was_measured(run, monkeypatch, tmp_path):
    measure = table1.measure

    def interrupted(*args):
        yield next(measure(*args))
        raise KeyboardInterrupt

    monkeypatch.setattr(table1, "measure", interrupted)
    code, printed, lines = run("table1", "sketching", "--quick")
    assert code == 130 and len(lines) == 1 and "| 12² " in printed.out and "Sketching" not in printed.out
    assert "interrupted: the results have what was measured until then" in printed.err
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["here-cpu-quick.jsonl"]


def test_a_part_that_fails_says_why_and_the_others_go_on_without_matplotlib(run, monkeypatch, tmp_path):
    def failing(*args):
        raise PartFailed(["the sketcher ended with exit code 3"])

    monkeypatch.setattr(table1, "measure", failing)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    for name in [name for name in sys.modules if name.startswith(("srt3d_ros.pictures", "matplotlib."))]:
        monkeypatch.delitem(sys.modules, name)
    code, printed, lines = run("table1", "figure1")
    assert code == 1 and "srt3d: table1: the sketcher ended with exit code 3" in printed.err
    assert {line["part"] for line in lines} == {"figure1"} and "Figure 1" in printed.out
    assert "figure1: no picture: matplotlib" in printed.err and not list((tmp_path / "out").glob("*.png"))


@pytest.mark.parametrize("options, said", [
    (["table2"], "part is table2: expected table1, figure1, sketching, ros, bytes, or none for all"),
    (["--repeats", "0"], "--repeats is 0: expected 1 or more"),
    (["--out", __file__], "test_benchmark.py: expected a folder"),
    (["bytes", "--tolerance", "3"], "--tolerance is 3: expected with --bytes FILE"),
    (["--device", "cuda"], "device is cuda"),
])
def test_a_mistake_is_one_line(options, said, refusal, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if "cuda" not in options or not torch.cuda.is_available():
        assert said in refusal("benchmark", *options) and not list(tmp_path.iterdir())


def test_rates_are_tried_through_real_nodes(repository, tmp_path):
    """In a process of its own, in which rclpy is started and ended."""
    script = ("import sys, dataclasses, srt3d_ros.cli.main as main\n"
              "from srt3d_ros.benchmark import command, plan, ros\n"
              "ros.LEAST_HZ = ros.MOST_HZ = ros.FIRST_HZ\n"
              "ros.KEEPS_UP, ros.LAST_CLOUD_S = 0.0, 30.0\n"       # the machine may be busy
              "command.FULL = dataclasses.replace(plan.FULL, side=16, rate_s=0.5)\n"
              "sys.exit(main.main(['benchmark', 'ros', '--device', 'cpu', '--out', sys.argv[1]]))")
    done = subprocess.run([sys.executable, "-c", script, str(tmp_path)], cwd=repository, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (file,) = tmp_path.glob("*.jsonl")
    lines = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    assert [line["what"] for line in lines] == ["rate", "highest rate"] and lines[0]["frames_sent"] == 5
    assert lines[0]["frames_lost"] < 5 and lines[0]["latency_ms"]["median"] > 0
    assert "Highest rate without loss" in done.stdout
