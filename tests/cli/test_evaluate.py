"""`srt3d evaluate`: from files or scenes to a table, a CSV and figures; a mistake is one line."""

import csv
import re
import shutil

import pytest

from srt3d_ros import read
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.datasets import photon_file
from srt3d_ros.evaluation import run as evaluation
from srt3d_ros.evaluation.run import outcome
from srt3d_ros.messages import sensor_message


@pytest.fixture(scope="module")
def folder(tmp_path_factory, layers):
    """layers.npz: photons of two surfaces; bare.npz: photons without reference, few.npz: few."""
    path, photons = tmp_path_factory.mktemp("evaluate"), read(layers)
    shutil.copy(layers, path)
    events = photons.frame
    photon_file.save(path / "bare.npz", photons.sensor, events)
    photon_file.save(path / "few.npz", photons.sensor, PhotonEvents(events.pixel[:240], events.toa[:240]))
    (path / "results.csv").write_text("of something else")
    return path


@pytest.fixture
def run(folder, tmp_path, monkeypatch, srt3d):
    """Run `srt3d evaluate` in the folder of the files; returns exit code, stdout, stderr and the rows of the table."""
    monkeypatch.chdir(folder)

    def call(*options):
        done = srt3d("evaluate", *options, "--out", tmp_path / "out")
        with open(tmp_path / "out" / "results.csv", newline="", encoding="utf-8") as file:
            return *done, list(csv.DictReader(file))
    return call


def test_every_method_is_held_against_a_file(run, tmp_path):
    code, out, _, rows = run("layers.npz")
    rows = {row["method"]: row for row in rows}
    assert code == 0 and list(rows) == list(METHODS)
    ours = rows["pooled"]
    assert float(ours["true_detections_percent"]) > 99 and ours["surfaces"] == "2" and ours["sketch_size"] == "10"
    assert sum(line.startswith("| ") for line in out.splitlines()) == 1 + len(METHODS)
    assert (tmp_path / "out" / "reconstructions_files.png").exists()


def test_held_out_photons_judge_files_and_do_so_by_themselves_where_there_is_no_reference(run, tmp_path):
    code, out, err, rows = run("bare.npz", "few.npz", "layers.npz", "--methods", "pooled", "--surfaces", "2")
    rows = {row["source"]: row for row in rows}
    bare = rows["bare"]
    assert code == 0 and [rows[name]["held_out"] for name in ("bare", "few", "layers")] == ["0.4", "", ""]
    assert float(bare["held_out_nats"]) > 10 * float(bare["held_out_std"]) > 0
    assert float(bare["photons_per_pixel"]) == pytest.approx(36, rel=0.05) and not bare["true_detections_percent"]
    shown = f"| {float(bare['held_out_nats']):.1f} ± {float(bare['held_out_std']):.1f}"
    assert shown in out and "| – ± –" not in out and "nan" not in out
    assert "bare: no reference: clouds of 60% of the photons are judged by how well" in err
    assert "few: no reference, and too few photons" in err and "layers: no" not in err
    (tmp_path / "wider.json").write_text(sensor_message.to_json(read("layers.npz").sensor.replace(bin_width_s=1e-10)))
    code, _, err, (row,) = run("layers.npz", "--methods", "pooled", "--held-out-photons", "0.4",  # replaces the others
                               "--sensor-file", tmp_path / "wider.json", "--tolerance", "75mm")
    assert code == 0 and row["held_out"] == "0.4" and row["true_detections_percent"]
    assert float(row["tolerance_bins"]) == pytest.approx(5, rel=0.01) and "not as in the file: bin_width_s" in err


def test_a_scene_is_simulated_at_every_setting(run, tmp_path):
    code, out, _, rows = run("--scene", "net", "--sbr", "10", "1", "--ppp", "3", "30", "--sketch-size", "4", "10",
                             "--methods", "pooled", "--tolerance", "75mm")
    assert code == 0 and sorted((row["source"], row["sbr"], row["ppp"], row["sketch_size"]) for row in rows) == [
        ("net", sbr, ppp, m) for sbr in ("1", "10") for ppp in ("3", "30") for m in ("10", "4")]
    assert [float(row["tolerance_bins"]) for row in rows] == pytest.approx([2] * len(rows), rel=0.01)
    assert sum(line.startswith("| net") for line in out.splitlines()) == 8
    assert [path.name for path in (tmp_path / "out").glob("*.png")] == ["reconstructions_net.png"]


def test_every_method_has_the_published_figures_on_the_simulated_head(run, repository):
    results = (repository / "docs/RESULTS.md").read_text(encoding="utf-8")
    table = results[results.index("## On simulated scenes"):]
    code, out, _, rows = run("simulator")
    assert code == 0 and out.startswith("A surface counts as found within 40 mm (133.3 bins).\n")
    assert [row["method"] for row in rows] == list(METHODS)
    for row in rows:
        assert (row["source"], row["sbr"], row["ppp"]) == ("bust", "1", "10")
        line = re.search(rf"^\| {row['method']} .*$", table, re.MULTILINE)[0]
        published = [float(figure) for figure in line.split("|")[3].split("/")]      # at 10 photons per pixel
        found = [float(row[name]) for name in ("true_detections_percent", "false_detections_percent", "dae_mm")]
        assert found == pytest.approx(published, rel=0.02, abs=0.15), row["method"]


def test_an_interrupted_evaluation_leaves_its_rows_and_the_next_one_starts_anew(run, monkeypatch):
    def stopped(case, run, observation):
        if case.ppp == 30:
            raise KeyboardInterrupt
        return outcome(case, run, observation)

    command = ("--scene", "net", "--sbr", "10", "--ppp", "3", "30", "--methods", "pooled")
    with monkeypatch.context() as patch:
        patch.setattr(evaluation, "outcome", stopped)
        code, _, _, rows = run(*command)
    assert code == 130 and [row["ppp"] for row in rows] == ["3"]
    code, _, _, rows = run(*command)
    assert code == 0 and [row["ppp"] for row in rows] == ["3", "30"]


@pytest.mark.parametrize(("arguments", "named"), [
    (["absent.npz"], "absent.npz"),
    (["--scene", "head"], "argument --scene: invalid choice: 'head'"),
    (["layers.npz", "--methods", "magic"], "method is magic"), (["simulator", "--ppp", "-1"], "--ppp is -1"),
    (["layers.npz", "--ppp", "3"], "--ppp works only with simulated scenes"),
    (["--sketch-size", "0"], "--sketch-size is 0"), (["layers.npz", "--tolerance", "near"], "--tolerance is near"),
    (["bare.npz", "--held-out-photons", "nan"], "--held-out-photons is nan"),
    (["bare.npz", "--scene", "net", "--held-out-photons", "0.4"], "--held-out-photons works only with photon files"),
    (["few.npz", "--held-out-photons", "0.4"],
     "few has 240 photons: --held-out-photons 0.4 needs 250 or more"),
    (["--scene", "net", "--sensor-file", "a.json"], "--sensor-file works only with photon files"),
    (["bare.npz", "--out", "."], "results.csv was not written by srt3d evaluate"),
])
def test_a_mistake_is_one_line_and_exit_code_2(folder, tmp_path, monkeypatch, refusal, arguments, named):
    monkeypatch.chdir(folder)
    assert named in refusal("evaluate", "--out", tmp_path / "out", *arguments)
    assert not (tmp_path / "out").exists()
