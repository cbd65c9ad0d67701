"""SRT3D as published and RT3D: what the denoiser adds, and how good both are."""

import numpy as np
import pytest

from srt3d_ros import read
from srt3d_ros.core.baselines.plug_and_play import depth_scale_bins
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.metrics import Metrics, evaluate
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from tests.core.scenes import make_sensor, run, simulate


def test_the_papers_numbers_of_steps_and_denoisings_are_run(monkeypatch):
    sensor, calls = make_sensor(8, 8), []
    method = METHODS["srt3d"].build(sensor, (1, 2, 3))
    kernels = method.kernels
    for name in ("pixelwise", "apss"):
        monkeypatch.setattr(kernels, name, lambda *args, name=name, kernel=getattr(kernels, name), **more: (
            calls.append(name) or kernel(*args, **more)))
    method(sketch_photons(simulate(np.full((8, 8), 200.0), 10, 20), sensor, (1, 2, 3)))
    assert calls == 5 * ["pixelwise"] + 25 * ["apss", "pixelwise"] + ["apss", "pixelwise"]


def test_depth_counts_by_the_distance_of_neighbouring_rays_within_what_the_peak_allows():
    sensor = SensorModel(40, 40, 600, 20e-12, np.ones(3), toa_offset_bins=400)
    pitch_bins = 500 * np.tan(np.radians(15)) / 20                      # 30° over 40 pixels at 500 bins
    assert depth_scale_bins(sensor, 100.0, peak_bins=40) == pytest.approx(6 * pitch_bins, rel=0.1)
    assert depth_scale_bins(sensor, 100.0, peak_bins=4) == 8
    assert depth_scale_bins(sensor, 100.0, peak_bins=400) == 200


# ---- On measured photons: TD at least, FD and DAE at most; m = 10, τ = 10 bins

MEASURED = {
    ("rt3d", "polystyrene_head_142_1ppp"): (0.95, 0.03, 1.3),
    ("srt3d", "polystyrene_head_142_full"): (0.995, 0.01, 0.45),
    ("srt3d", "art_real_unif_ppp5_sbr1"): (0.87, 0.03, 2.0)}


def measured(folder, name: str, method: str) -> tuple[Metrics, object]:
    photons = read(folder / "photons" / f"{name}.npz")
    cloud = run(method, photons.frame, photons.sensor)
    return evaluate(cloud, photons.reference_depth_bins, 10, photons.sensor.num_bins), photons


@pytest.mark.parametrize(("method", "name"), MEASURED)
def test_quality_on_measured_photons(shared_data, method, name):
    (found, _), (true, false, error) = measured(shared_data, name, method), MEASURED[method, name]
    assert found.true_detections >= true and found.false_detections <= false and found.dae_bins <= error, found


def test_rt3d_is_as_good_as_its_authors_program_on_the_same_photons(shared_data):
    name = "art_real_unif_ppp5_sbr1"
    found, photons = measured(shared_data, name, "rt3d")
    with np.load(shared_data / "photons" / f"{name}.npz") as file:
        theirs = np.abs(file["rt3d_depth_bins"] - photons.reference_depth_bins[0])
    assert found.true_detections >= (theirs <= 10).mean() and found.false_detections <= (theirs > 10).mean()
    assert found.dae_bins <= 1.05 * theirs[theirs <= 10].mean()
