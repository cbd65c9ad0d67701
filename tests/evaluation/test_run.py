"""Running methods: each once, its row complete and right, and nothing twice."""

from dataclasses import replace

import numpy as np
import pytest
from tqdm import tqdm

from srt3d_ros.core import methods
from srt3d_ros.core.methods import METHODS, Method
from srt3d_ros.core.metrics import evaluate
from srt3d_ros.evaluation.cases import of_files, simulated
from srt3d_ros.evaluation.report import load_cloud
from srt3d_ros.evaluation.results import Results, number
from srt3d_ros.evaluation.run import NOMINAL, aligned_reference, jobs_for, judge, run, with_clouds

BAR = {"disable": True}
POOLED = METHODS["pooled"]


@pytest.fixture
def results(tmp_path):
    return Results(tmp_path / "results.csv")


def test_methods_on_photons_run_once_and_those_on_sketches_for_each_size(scene_file):
    on_photons = Method("all", "", "photons", "nowhere:None")
    jobs = jobs_for(simulated(str(scene_file), [10], [3]), [POOLED, on_photons], (5, 10))
    assert [(job.method.name, job.sketch_size) for job in jobs] == [("pooled", 5), ("pooled", 10), ("all", None)]


def test_a_simulated_scene_is_judged_in_every_respect(scene_file, results):
    jobs = jobs_for(simulated(str(scene_file), [10], [100]), [POOLED], (10,))
    assert run(jobs, results, tqdm(**BAR)) == []
    row = results[jobs[0].key]
    assert number(row, "true_detections_percent") > 99 and number(row, "false_detections_percent") < 1
    assert 0 < number(row, "dae_mm") < 1
    assert number(row, "dae_mm") == pytest.approx(number(row, "dae_bins") * 0.3, rel=1e-3)
    assert 0 < number(row, "iae") < 0.2 and number(row, "points") == pytest.approx(16 * 24, rel=0.02)
    assert number(row, "photons_per_pixel") == pytest.approx(100, rel=0.02) and number(row, "background_nmse") > 0
    shares = [float(share) for share in row["within_nominal_percent"].split(";")]
    assert shares == sorted(shares) and len(shares) == len(NOMINAL)
    assert dict(zip(NOMINAL, shares))[0.6827] == pytest.approx(number(row, "within_1_std_percent"), abs=0.5)
    assert len(row["frequencies"].split(";")) == 10 and number(row, "reconstruct_ms") > 0


@pytest.mark.parametrize("name", ["pooled", "xcorr"])
def test_with_upsampling_every_method_is_judged_on_the_finer_pixels(name, results, tmp_path):
    case, = simulated("net", [10], [300], upsampling=2)
    size = 10 if METHODS[name].needs == "sketch" else None
    jobs = with_clouds(jobs_for([case], [METHODS[name]], (10,)), lambda job: True, tmp_path)
    assert run(jobs, results, tqdm(**BAR)) == [] and jobs[0].sketch_size == size
    row = results[jobs[0].key]
    assert number(row, "true_detections_percent") > 90 and number(row, "iae") < 0.3
    assert number(row, "photons_per_pixel") == pytest.approx(300, rel=0.02)
    assert load_cloud(jobs[0].cloud_path).background.shape == (64, 64)


def test_points_in_empty_pixels_of_a_scene_are_false_and_those_of_files_are_not(scene_file, layers):
    for case, false in ((simulated(str(scene_file), [10], [3])[0], 1.0), (of_files([str(layers)])[0], 0.0)):
        observation = case.observe()
        cloud = observation.true_cloud(case.sensor)
        observation.depth_bins[:, :, ::2] = np.nan          # half the pixels
        assert judge(cloud, case, observation)["false_detections_percent"] == pytest.approx(100 * false)


def test_what_is_done_is_not_done_again_and_the_bar_ends_at_all_jobs(scene_file, results, tmp_path):
    (tmp_path / "clouds").mkdir()
    jobs = with_clouds(jobs_for(simulated(str(scene_file), [10], [3, 30]), [POOLED], (10,)),
                       lambda job: job.case.ppp == 30, tmp_path / "clouds")
    run(jobs, results, tqdm(**BAR))
    kept, = (tmp_path / "clouds").iterdir()
    assert kept == jobs[1].cloud_path and len(load_cloud(kept)) == number(results[jobs[1].key], "points")
    kept.unlink()                               # its row is there, but not its cloud
    jobs[0] = replace(jobs[0], case=replace(jobs[0].case, observe=lambda: pytest.fail("simulated again")))
    steps, bar = [], tqdm(**BAR)
    bar.update = lambda n=1: steps.append(n)
    run(jobs, Results(results.path), bar)
    assert kept.exists() and sum(steps) == 2


def test_what_a_method_refuses_is_a_note_and_the_others_go_on(scene_file, results):
    jobs = jobs_for(simulated(str(scene_file), [10], [3]), [POOLED], (1000, 10))
    notes = run(jobs, results, tqdm(**BAR))
    assert len(notes) == 1 and notes[0].startswith("step, SBR 10, 3 ppp: pooled, m = 1000: sketch_size is 1000")
    assert jobs[1].key in results and jobs[0].key not in results


def test_a_reference_measured_apart_is_aligned_and_judged_where_photons_show_it(layers, results):
    plain, aligned = of_files([str(layers)])[0], of_files([str(layers)], aligned=(1,), seen=(8, 20))[0]
    jobs = jobs_for([plain, aligned], [POOLED], (10,))
    run(jobs, results, tqdm(**BAR))
    nothing = replace(aligned, seen=(10**6, 20))
    observation = nothing.observe()
    _, counted, _ = aligned_reference(observation.true_cloud(nothing.sensor), nothing, observation)
    assert counted[0].all() and not counted[1].any()
    first, second = (results[job.key] for job in jobs)
    assert first["true_detections_by_surface_percent"].split(";") == ["100", "0"]
    shares = [float(share) for share in second["true_detections_by_surface_percent"].split(";")]
    assert min(shares) > 99 and number(second, "offset_bins") == pytest.approx(13, abs=0.5)
    assert number(second, "false_detections_percent") < 1 and number(second, "dae_bins") < 1


def test_the_true_cloud_is_perfect(layers, scene_file):
    for case in (*of_files([str(layers)]), *simulated(str(scene_file), [10], [3])):
        observation = case.observe()
        cloud = observation.true_cloud(case.sensor)
        found = evaluate(cloud, observation.depth_bins, 0.01, case.sensor.num_bins, observation.intensity)
        assert (found.true_detections, found.false_detections) == (1, 0) and not found.iae > 1e-6


def test_frequencies_are_those_that_the_method_asks_for(scene_file, results, monkeypatch):
    consecutive = Method("other", "", "sketch", POOLED.where, frequencies="consecutive")
    monkeypatch.setitem(methods.METHODS, "other", consecutive)
    jobs = jobs_for(simulated(str(scene_file), [10], [30]), [consecutive], (5,))
    run(jobs, results, tqdm(**BAR))
    assert results[jobs[0].key]["frequencies"] == "1;2;3;4;5"
