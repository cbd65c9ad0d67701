"""Running methods: each once, its row complete and right."""

import numpy as np
import pytest
from tqdm import tqdm

from srt3d_ros.core.methods import METHODS, Method
from srt3d_ros.core.metrics import evaluate
from srt3d_ros.evaluation.cases import of_files, simulated
from srt3d_ros.evaluation.run import jobs_for, judge, run
from srt3d_ros.evaluation.scores import RESULT_COLUMNS

POOLED = METHODS["pooled"]


def outcomes(cases, methods=(POOLED,), sizes=(10,)):
    """What comes of the methods on the cases, and the notes."""
    jobs, notes = jobs_for(cases, methods, sizes), []
    with tqdm(total=len(jobs), disable=True) as bar:
        return list(run(jobs, notes, bar)), notes


def test_methods_on_photons_run_once_and_those_on_sketches_for_each_size():
    on_photons = Method("all", "", "photons", object)
    jobs = jobs_for(simulated("net", [10], [3]), [POOLED, on_photons], (5, 10))
    assert [(job.method.name, job.sketch_size) for job in jobs] == [("pooled", 5), ("pooled", 10), ("all", None)]


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


def test_what_a_method_refuses_is_a_note_and_the_others_go_on():
    found, notes = outcomes(simulated("net", [10], [3]), sizes=(1000, 10))
    assert len(notes) == 1 and notes[0].startswith("net, SBR 10, 3 ppp: pooled, m = 1000: sketch_size is 1000")
    assert [outcome.job.sketch_size for outcome in found] == [10]


def test_the_true_cloud_is_perfect(layers):
    for case in (*of_files([str(layers)]), *simulated("net", [10], [3])):
        observation = case.observe()
        cloud = observation.true_cloud(case.sensor)
        found = evaluate(cloud, observation.depth_bins, 0.01, case.sensor.num_bins, observation.intensity)
        assert (found.true_detections, found.false_detections) == (1, 0) and not found.iae > 1e-6


def test_frequencies_are_those_that_the_method_asks_for():
    (outcome,), _ = outcomes(simulated("net", [10], [30]), [METHODS["smle"]], (5,))
    assert tuple(outcome.row["frequencies"]) == (1, 2, 3, 4, 5)
