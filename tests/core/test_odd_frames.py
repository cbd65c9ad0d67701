"""Odd sensors and frames give numbers or one line, and times count from one position."""

from dataclasses import replace
from math import exp
from statistics import NormalDist

import numpy as np
import pytest

from srt3d_ros.core.keys import keys
from srt3d_ros.core.method.background import Background
from srt3d_ros.core.method.matched_frame import Matcher
from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.design import histogram
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.core.sketching.sums import MAX_PIXEL_PHOTONS, PhaseSums
from srt3d_ros.errors import InvalidInput
from tests.core.scenes import assert_finite, run, simulate

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


ROWS, COLS, BINS, WAIT = 12, 14, 153, 40         # the gate opens WAIT bins after the laser pulse
# Jitter of a photon's time, bins: normal of SIGMA plus exponential of mean DECAY; steep rise, slow decay.
SIGMA, DECAY = 1.2, 2.4
PHI = NormalDist(0, SIGMA).cdf
JITTER = np.diff([PHI(x) - exp(SIGMA**2 / (2 * DECAY**2) - x / DECAY) * PHI(x - SIGMA**2 / DECAY)
               for x in np.arange(-8, 24) - 0.5])
# How a driver may send t, the time after the gate's opening in bins; and its toa_offset_bins.
DRIVERS = {
    "words": (WAIT + 0.5, lambda t: np.floor(t).astype(np.uint16)),
    "floats from the first bin's centre": (WAIT + 0.5, lambda t: ((t - 0.5) % BINS).astype(np.float32)),
    "floats from its edge": (WAIT, lambda t: t.astype(np.float32)),
}
NEAR = 0.04                                   # bins: some four standard deviations of the mean of all photons' times
ROUGH = {"xcorr": 2 * NEAR, "rt3d": 2 * NEAR}     # they interpolate between bins: a parabola, a straight line


def make(driver: str, **changes) -> SensorModel:
    return SensorModel(ROWS, COLS, BINS, 250e-12, JITTER, irf_ref=8, toa_offset_bins=DRIVERS[driver][0], **changes)


def observe(driver: str, range_m: float, photons: int) -> PhotonEvents:
    """Photons of a target at this range, timed with a clock that starts when the gate opens."""
    rng = np.random.default_rng(3)
    pixel = np.repeat(np.arange(ROWS * COLS, dtype=np.uint32), photons)
    t = 2 * range_m / 299_792_458 / 250e-12 - WAIT
    t += rng.normal(0, SIGMA, len(pixel)) + rng.exponential(DECAY, len(pixel))
    return PhotonEvents(pixel, DRIVERS[driver][1](t % BINS))


def mean_range(cloud) -> float:
    assert len(cloud) == ROWS * COLS
    return float(np.linalg.norm(cloud.xyz.astype(np.float64), axis=1).mean())


@pytest.mark.parametrize("driver", DRIVERS)
@pytest.mark.parametrize("method", METHODS)
def test_every_method_gets_the_range_of_the_target(method, driver):
    sensor = make(driver)
    found = mean_range(run(method, observe(driver, 3.011, photons=300), sensor))
    assert abs(found - 3.011) < ROUGH.get(method, NEAR) * sensor.bin_width_m


def test_a_dark_frame_and_its_background_count_from_the_same_position():
    shape = np.exp(-np.arange(BINS) / 20) + 0.05
    rng = np.random.default_rng(0)
    t = rng.choice(BINS, 200_000, p=shape / shape.sum()) + rng.random(200_000)
    pixel = rng.integers(0, ROWS * COLS, len(t)).astype(np.uint32)
    for driver, (_, send) in DRIVERS.items():
        dark = histogram(PhotonEvents(pixel, send(t)), make(driver))
        sensor = make(driver, background_shape=dark)
        sketch = sketch_photons(PhotonEvents(pixel, send(t)), sensor, (1, 2, 5, 20))
        matcher = Matcher(sensor, (1, 2, 5, 20))
        background = Background(matcher, "sensor")
        mean = background.removed(background.first, sketch).mean
        shown = (matcher.equaliser * sketch.sums).mean((0, 1))
        left = shown - matcher.passed[0, 0] * mean * len(t) / sensor.pixels
        assert np.abs(left).max() < 0.01 * np.abs(shown).max(), driver
