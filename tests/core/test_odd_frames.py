"""Sensors and frames that nobody should have: numbers come out, or one line says what cannot be used."""

from dataclasses import replace

import numpy as np
import pytest

from srt3d_ros.core.keys import keys
from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.core.sketching.sums import MAX_PIXEL_PHOTONS, PhaseSums
from srt3d_ros.errors import InvalidInput
from tests.core.scenes import assert_finite, simulate

T = 300
IRF = np.exp(-np.linspace(-2, 4, 25)**2)


def made(rows=9, cols=12, **changes) -> tuple[SensorModel, tuple[int, ...]]:
    sensor = SensorModel(rows, cols, T, 50e-12, IRF, **changes)
    return sensor, choose_frequencies("auto", sensor)


def garbage(sensor: SensorModel, frequencies, seed: int, photons=MAX_PIXEL_PHOTONS) -> PhaseSums:
    """Means of unit vectors that no photons had, of pixels with up to so many."""
    rng, shape = np.random.default_rng(seed), (sensor.rows, sensor.cols)
    numbers = rng.integers(0, photons, shape, endpoint=True).astype(np.uint32)
    phase = 2j * np.pi * np.array(frequencies) / T * rng.uniform(0, T, (*shape, 1))
    return PhaseSums(frequencies, (np.exp(phase) * numbers[..., None]).astype(np.complex64), numbers, sensor=sensor)


def plane(sensor: SensorModel, depth: float, seed=0) -> PhaseSums:
    frame = simulate(np.full((sensor.rows, sensor.cols), depth), np.inf, 20, sensor, seed)
    return sketch_photons(frame, sensor, choose_frequencies("auto", sensor))


@pytest.mark.parametrize("gain", keys(SensorModel)["gain"].bounds)
def test_full_pixels_of_the_least_and_the_greatest_gain_give_numbers(gain):
    sensor, frequencies = made(gain=np.full((9, 12), gain))
    pooled = Pooled(sensor, frequencies, surfaces=2)
    for seed in range(4):
        sketch = garbage(sensor, frequencies, seed)
        flat = np.broadcast_to(np.exp(2j * np.pi * np.array(frequencies) / T * 90), sketch.sums.shape)
        for sums in (sketch.sums, (flat * sketch.photons[..., None]).astype(np.complex64)):
            cloud = pooled(replace(sketch, sums=sums))
            assert_finite(cloud, T)
    assert (cloud.surface == 0).sum() == sensor.pixels


@pytest.mark.parametrize("value", [np.nan, -np.inf, 1e38, -1e20j])
@pytest.mark.parametrize("method", ["pooled", "smle"])
def test_a_sketch_that_is_not_of_numbers_is_refused(method, value):
    sensor, frequencies = made()
    sketch = garbage(sensor, frequencies, 0, photons=9)
    sketch.sums[3, 4, 1] = value
    with pytest.raises(InvalidInput, match="^sketch is .*: expected sums of unit vectors, as many as photons"):
        METHODS[method].build(sensor, frequencies, device="cpu")(sketch)


@pytest.mark.parametrize(("depth", "late"), [(0.0, 0.0), (0.5, -40.0), (T - 0.01, 0.0), (T - 12.0, 17.25), (12.0, 1e5)])
def test_a_surface_at_the_ends_of_the_period_is_found_there_whatever_the_delay(depth, late):
    sensor, frequencies = made(delay_bins=np.full((9, 12), late))
    cloud = Pooled(sensor, frequencies)(plane(sensor, depth))
    assert len(cloud) == sensor.pixels and (cloud.depth_bins >= 0).all() and (cloud.depth_bins < T).all()
    assert np.abs(circular_difference(cloud.depth_bins.astype(float), depth, T)).max() < 1.5
