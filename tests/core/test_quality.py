"""How good pooled is with its defaults and m = 10, on measured and on simulated photons: what this project promises."""

import pytest

from srt3d_ros import read
from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.metrics import evaluate
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.datasets.simulation.scene import default_sensor
from srt3d_ros.datasets.simulation.simulator import Simulator

MEASURED = {        # tolerance τ, bins; then TD at least, FD and DAE (bins) at most
    "polystyrene_head_142_1ppp": (10, 0.992, 0.010, 0.85), "polystyrene_head_142_10ppp": (10, 0.996, 0.005, 0.42),
    "polystyrene_head_142_full": (10, 0.998, 0.003, 0.22), "art_real_unif_ppp5_sbr10": (10, 0.996, 0.005, 0.50),
    "art_real_unif_ppp5_sbr1": (10, 0.988, 0.013, 0.75), "art_real_unif_ppp5_sbr0.1": (10, 0.84, 0.105, 2.45),
    "mannequin_face_340": (40, 0.987, 0.013, 2.10)}

SIMULATED = {       # SBR, ppp: TD at least, FD at most, DAE at most, mm; the moving head, τ = 40 mm
    (10, 1): (0.99, 0.015, 1.3), (1, 1): (0.97, 0.025, 2.0), (0.1, 10): (0.945, 0.035, 2.7),
    (1, 10): (0.997, 0.005, 0.9)}


def reconstruct(frame, sensor, **options):
    frequencies = choose_frequencies("auto", sensor, 10)
    return Pooled(sensor, frequencies, **options)(sketch_photons(frame, sensor, frequencies))


@pytest.mark.parametrize("name", MEASURED)
def test_on_measured_photons(shared_data, name):
    photons = read(shared_data / "photons" / f"{name}.npz")
    tolerance, true, false, error = MEASURED[name]
    cloud = reconstruct(photons.frame, photons.sensor)
    found = evaluate(cloud, photons.reference_depth_bins, tolerance, photons.sensor.num_bins)
    assert found.true_detections >= true and found.false_detections <= false and found.dae_bins <= error, found


@pytest.mark.parametrize(("sbr", "ppp"), SIMULATED)
def test_on_simulated_photons_and_errors_are_as_large_as_is_said(sbr, ppp):
    sensor = default_sensor()
    frame, depth = Simulator(sbr=sbr, ppp=ppp, seed=2).frame(0)
    found = evaluate(reconstruct(frame, sensor), depth, 40e-3 / sensor.bin_width_m, sensor.num_bins)
    true, false, error_mm = SIMULATED[sbr, ppp]
    assert found.true_detections >= true and found.false_detections <= false
    assert found.dae_bins * sensor.bin_width_m * 1e3 <= error_mm
    assert 0.60 <= found.within_1_std <= 0.76 and 0.87 <= found.within_2_std <= 0.98, found     # false ones count too


def test_two_surfaces_are_kept_where_there_are_two_and_edges_show_no_double_points(shared_data):
    photons = read(shared_data / "photons" / "art_real_unif_ppp5_sbr10.npz")
    one, two = (reconstruct(photons.frame, photons.sensor, surfaces=surfaces) for surfaces in (1, 2))
    assert len(two) - (two.surface == 0).sum() < 0.005 * len(one)
    photons = read(shared_data / "photons" / "two_layer_100.npz")
    cloud = reconstruct(photons.frame, photons.sensor, surfaces=2)
    assert (cloud.surface == 1).sum() > 0.95 * photons.sensor.pixels
    found = evaluate(cloud, photons.reference_depth_bins, 40, photons.sensor.num_bins)
    assert found.by_surface[0] > 0.93
