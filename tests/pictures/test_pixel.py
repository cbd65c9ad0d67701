"""The figure of one pixel: what its points make expected."""

import numpy as np
import pytest

from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.pictures.pixel import expected_counts, residual

IRF = np.exp(-np.linspace(-2, 3, 26)**2)
DELAY, GAIN = np.full((4, 5), 3.5, np.float32), np.linspace(0.5, 2, 20, dtype=np.float32).reshape(4, 5)


def cloud_of(sensor, depths, intensities, background=8.0):
    layers = [np.broadcast_to(np.reshape(values, (1, -1, 1)), (4, len(values), 5)) for values in (depths, intensities)]
    return PointCloud.from_layers(sensor, *layers, np.full((4, 5), background), 0)


def test_the_fit_is_that_of_the_photons():
    """4,000 photons a pixel in all, at a fractional depth and delay, seen with a gain."""
    sensor = SensorModel(4, 5, 200, 1e-10, IRF, delay_bins=DELAY, gain=GAIN)
    simulator = Simulator(StaticScene(sensor.range_m(np.full((4, 5), 80.25))), sensor, sbr=4, ppp=4_000)
    events, _ = simulator.frame(0)
    row, col = 2, 3
    counts = np.bincount(events.toa[events.pixel == row * 5 + col], minlength=200)
    background = counts[120:].mean() * 200
    cloud = cloud_of(sensor, [80.25], [(counts.sum() - background) / GAIN[row, col]], background)
    left = residual(counts, expected_counts(cloud, row, col))
    assert np.sqrt(np.mean(left**2)) < 1.25 and np.abs(left).max() < 5
    wrong = cloud_of(sensor, [81.25], [cloud.intensity[0]], background)
    assert np.sqrt(np.mean(residual(counts, expected_counts(wrong, row, col))**2)) > 1.5


def test_points_background_gain_and_cycles():
    shape = np.where(np.arange(100) < 50, 3.0, 1.0)
    sensor = SensorModel(4, 5, 100, 1e-10, IRF, gain=GAIN, background_shape=shape)
    expected = expected_counts(cloud_of(sensor, [30.0, 98.0], [5.0, 2.0]), 1, 2)
    assert expected.sum() == pytest.approx(8 + 7 * GAIN[1, 2], rel=1e-5) and expected[2] > expected[16]      # it wraps
    assert expected[16] / expected[60] == pytest.approx(3)
    first = expected_counts(cloud_of(sensor.replace(cycles=10), [30.0, 98.0], [5.0, 2.0]), 1, 2)
    assert first.sum() == pytest.approx(10 * -np.expm1(-expected.sum() / 10), rel=1e-5)
    assert first[0] == pytest.approx(expected[0], rel=0.02) and first[98] < 0.4 * expected[98]


@pytest.mark.parametrize("periods", [0.5, 1.0, 1.5, 3.2])
def test_dead_times_cost_as_many_photons_as_in_the_simulator(periods):
    options = {"cycles": 1000, "dead_time_s": periods * 2e-8}
    sensor = SensorModel(4, 5, 200, 1e-10, IRF, **options)
    simulator = Simulator(StaticScene(sensor.range_m(np.full((4, 5), 80.0))), sensor, sbr=4, ppp=800)
    counts, (_, signal, background) = np.bincount(simulator.frame(0)[0].toa, minlength=200), simulator.expected(0)
    expected = expected_counts(cloud_of(sensor, [80.0], [signal[0, 2, 3]], background[2, 3]), 2, 3)
    assert 20 * expected.sum() == pytest.approx(counts.sum(), rel=0.06)
    assert np.sqrt(np.mean(residual(counts, 20 * expected)**2)) < 2


def test_residuals_of_few_photons_are_of_the_order_of_sigma():
    assert residual(np.array([0, 1, 100]), np.array([0.0, 1.0, 81.0])) == pytest.approx([0, 0, 2.04], abs=0.02)
    assert 3 < residual(np.array([1]), np.array([0.002]))[0] < 4
