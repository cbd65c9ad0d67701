"""What is evaluated, and methods that run on it: each once, its row complete; the table, results.csv and pictures."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from tqdm import tqdm

from srt3d_ros import read
from srt3d_ros.core.methods import METHODS, Method
from srt3d_ros.core.metrics import evaluate
from srt3d_ros.core.point_cloud import POINT_FIELDS
from srt3d_ros.datasets.simulation.scene import default_sensor
from srt3d_ros.errors import InvalidInput
from srt3d_ros.evaluation.cases import of_files, simulated, tolerance_bins
from srt3d_ros.evaluation.drawings import draw_row
from srt3d_ros.evaluation.run import judge, run_all, runs_of
from srt3d_ros.evaluation.scenes import net_sensor
from srt3d_ros.evaluation.scores import HEADINGS, RESULT_COLUMNS, is_table, markdown, table_of_rows

POOLED = METHODS["pooled"]


def outcomes(cases, methods=(POOLED,), sizes=(10,)):
    """What comes of the methods on the cases, and the notes."""
    notes = []
    with tqdm(disable=True) as bar:
        return list(run_all(cases, runs_of(methods, sizes), notes, bar)), notes


def test_methods_run_once_or_for_each_size_and_what_they_refuse_is_a_note():
    on_photons = Method("all", "", "photons", object)
    assert runs_of([POOLED, on_photons], (5, 10)) == [(POOLED, 5), (POOLED, 10), (on_photons, None)]
    found, notes = outcomes(simulated("net", [10], [3]), sizes=(1000, 10))
    assert len(notes) == 1 and notes[0].startswith("net, SBR 10, 3 ppp: pooled, m = 1000: sketch_size is 1000")
    assert [outcome.run.sketch_size for outcome in found] == [10]
    (outcome,), _ = outcomes(simulated("net", [10], [30]), [METHODS["smle"]], (5,))
    assert tuple(outcome.row["frequencies"]) == (1, 2, 3, 4, 5)


def test_a_simulated_scene_is_judged_in_every_respect():
    (outcome,), notes = outcomes(simulated("bust", [10], [100]))
    row = outcome.row
    assert not notes and len(outcome.cloud) == row["points"] and set(row) <= set(RESULT_COLUMNS)
    assert row["true_detections_percent"] > 99 and row["false_detections_percent"] < 1
    assert 0 < row["dae_mm"] < 1
    assert row["dae_mm"] == pytest.approx(row["dae_bins"] * 0.3, rel=1e-3)
    assert 0 < row["iae"] < 0.2 and row["points"] == pytest.approx(141**2, rel=0.02)
    assert row["photons_per_pixel"] == pytest.approx(100, rel=0.02)
    assert 40 < row["within_1_std_percent"] < row["within_2_std_percent"] <= 100
    assert len(row["frequencies"]) == 10 and row["reconstruct_ms"] > 0


def test_points_in_empty_pixels_of_a_scene_are_false_and_those_of_files_are_not(layers):
    for case, false in ((simulated("net", [10], [3])[0], 1.0), (of_files([str(layers)])[0], 0.0)):
        observation = case.observe()
        cloud = observation.true_cloud(case.sensor)
        observation.depth_bins[:, :, ::2] = np.nan          # half the pixels
        assert judge(cloud, case, observation)["false_detections_percent"] == pytest.approx(100 * false)


def test_the_true_cloud_is_perfect(layers):
    for case in (*of_files([str(layers)]), *simulated("net", [10], [3])):
        observation = case.observe()
        cloud = observation.true_cloud(case.sensor)
        found = evaluate(cloud, observation.depth_bins, 0.01, case.sensor.num_bins, observation.intensity)
        assert (found.true_detections, found.false_detections) == (1, 0) and not found.iae > 1e-6


ROW = {"source": "bust", "sbr": 1.0, "ppp": 10.0, "method": "pooled", "sketch_size": 10,
       "photons_per_pixel": 9.9, "points": 100}
JUDGED = ROW | {"true_detections_percent": 90.0, "true_detections_by_surface_percent": (90.0,), "dae_mm": 2.0}


def test_a_row_is_on_the_disk_at_once_and_a_table_is_known_by_its_columns(tmp_path):
    path = tmp_path / "results.csv"
    with table_of_rows(path) as write:
        write(ROW | {"dae_mm": 1 / 3, "points": 19_881, "iae": float("nan"), "frequencies": (1, 2, 5), "sbr": 0.1})
        with open(path, newline="") as file:
            row, = csv.DictReader(file)
    wanted = {"dae_mm": "0.333333", "points": "19881", "iae": "", "frequencies": "1;2;5", "held_out": "", "sbr": "0.1"}
    assert tuple(row) == RESULT_COLUMNS and {name: row[name] for name in wanted} == wanted
    for content in (b"", b"a,b\n1,2\n", b"\xff\xfe\x00"):
        path.write_bytes(content)
        assert not is_table(path)
    with table_of_rows(path):
        pass
    assert is_table(path)


def test_the_table_has_a_dash_for_what_others_have():
    judged = JUDGED | {"true_detections_by_surface_percent": (99.06, 80.0), "false_detections_percent": 0.04}
    unjudged = ROW | {"sbr": None, "sketch_size": None, "source": "tower"}
    lines = markdown([judged, unjudged]).splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert set(cells[0]) < set(HEADINGS) and len({len(line) for line in cells}) == 1
    assert dict(zip(cells[0], cells[2])) == {
        "source": "bust", "SBR": "1", "photons / pixel": "9.9", "method": "pooled", "m": "10", "TD %": "99.1 + 80.0",
        "FD %": "0.0", "DAE mm": "2.00", "points": "100"}
    assert cells[3][:6] == ["tower", "–", "9.9", "pooled", "–", "–"]


def images(*clouds) -> list[np.ndarray]:
    """Those of a row of clouds, float [rows, cols, 3] from 0 to 255."""
    figure = Figure().subfigures(1, 1)
    draw_row(figure, 3, [("a$b_{", cloud, "caption") for cloud in clouds])
    return [axes.images[0].get_array().astype(float) for axes in figure.axes if axes.images]


def test_clouds_stand_beside_the_truth_in_the_same_colours_and_an_empty_one_is_dark(ball):
    truth, _ = ball
    part = replace(truth, **{name: getattr(truth, name)[truth.col < 24] for name in POINT_FIELDS})
    whole, half = images(truth, part)
    points = half.max(axis=2) > 60
    assert 0.1 < points.mean() < 0.8 * (whole.max(axis=2) > 60).mean()
    assert (np.abs(half - whole).max(axis=2)[points] < 60).mean() > 0.7
    empty, = images(truth.within(max_m=0))
    assert (empty.max(axis=2) < 60).all()


def test_a_file_has_as_many_surfaces_as_references_and_a_name_of_its_own(layers):
    case, = of_files([str(layers)])
    assert (case.source, case.sbr, case.surfaces, case.tolerance_bins) == ("layers", None, 2, 10)
    assert case.observe().depth_bins.shape == (2, 12, 20) and case.observe().intensity is None
    case, = of_files([str(layers)], "40", surfaces=1)
    assert (case.surfaces, case.tolerance_bins) == (1, 40)
    with pytest.raises(InvalidInput, match="^Two files are called layers: rename one"):
        of_files([str(layers), str(layers)])


def test_held_out_photons_are_no_longer_in_the_frame(layers):
    photons = read(layers)
    case, = of_files([str(layers)], held_out_share=0.25)
    seen = case.observe()
    assert case.held_out == 0.25 and seen.frame.photons + seen.held_out.photons == photons.frame.photons
    assert seen.held_out.photons / photons.frame.photons == pytest.approx(0.25, abs=0.02)
    assert np.array_equal(seen.depth_bins, photons.reference_depth_bins)


def test_a_tolerance_is_in_bins_or_millimetres_of_range():
    assert tolerance_bins("2.5", default_sensor()) == 2.5
    assert tolerance_bins("30mm", default_sensor()) == pytest.approx(100)
    assert tolerance_bins("75mm", net_sensor()) == pytest.approx(2, rel=0.01)           # bins of 250 ps
