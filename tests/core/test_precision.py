"""The weighting W = Σ_θ⁻¹ of the data term."""

import numpy as np

from srt3d_ros.core.frame import Matcher
from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.precision import Precision
from srt3d_ros.core.sensor import SPEED_OF_LIGHT, SensorModel
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.datasets.scene import StaticScene
from srt3d_ros.datasets.simulator import Simulator

T, BIN_S = 500, 16e-12
IRF = np.exp(-np.arange(60) / 12) * (1 - np.exp(-np.arange(60) / 2))        # steep in front, with a tail


def make_sensor(side: int) -> SensorModel:
    return SensorModel(side, side, T, BIN_S, IRF)


def photons_of_a_wall(sensor: SensorModel, sbr: float, ppp: float, depth_bins: float = 200.4):
    range_m = np.full((sensor.rows, sensor.cols), depth_bins * SPEED_OF_LIGHT / 2 * BIN_S, np.float32)
    return Simulator(StaticScene(range_m), sensor, sbr=sbr, ppp=ppp, seed=4).frame(0)


def test_without_signal_it_is_the_identity():
    sensor = make_sensor(8)
    k = choose("auto", sensor, 8)
    frame = Matcher(sensor, k)(sketch_photons(photons_of_a_wall(sensor, 1, 20)[0], sensor, k))
    weighted = Precision(sensor, k).weighted(frame, 0.0)
    np.testing.assert_allclose(weighted.energy, frame.energy, rtol=0.02)
    np.testing.assert_allclose(weighted.matched, frame.matched, atol=0.02 * np.abs(frame.matched).max())


def test_it_leaves_no_bias_and_smaller_errors_where_signal_is_plenty():
    sensor = make_sensor(60)
    k = choose("auto", sensor, 10)
    frame, truth = photons_of_a_wall(sensor, 50, 30)
    sketch = sketch_photons(frame, sensor, k)
    errors = {}
    for weighting in ("identity", "precision"):
        depth = Pooled(sensor, k, weighting=weighting)(sketch).image("depth_bins")
        errors[weighting] = circular_difference(depth, truth[0], T)
        assert abs(errors[weighting].mean()) < 0.5 * errors[weighting].std()
    assert errors["precision"].std() < 0.93 * errors["identity"].std()


def test_its_standard_deviations_are_those_of_its_errors():
    sensor = make_sensor(60)
    k = choose("auto", sensor, 10)
    frame, truth = photons_of_a_wall(sensor, 10, 10)
    cloud = Pooled(sensor, k, weighting="precision")(sketch_photons(frame, sensor, k))
    error = np.abs(circular_difference(cloud.image("depth_bins"), truth[0], T))
    assert 0.6 < (error < cloud.image("depth_std_bins")).mean() < 0.85
