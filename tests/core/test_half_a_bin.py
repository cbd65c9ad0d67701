"""Half a bin: times sent as truncated words, as floats from bins' centres and from their edges give one range."""

from math import exp
from statistics import NormalDist

import numpy as np
import pytest

from srt3d_ros.core.matched_frame import Matcher
from srt3d_ros.core.method.background import Background
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.design import histogram
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from tests.core.scenes import run

ROWS, COLS, T, WAIT = 12, 14, 153, 40         # the gate opens WAIT bins after the laser pulse
# Jitter of a photon's time, bins: normal of SIGMA plus exponential of mean DECAY; steep rise, slow decay.
SIGMA, DECAY = 1.2, 2.4
PHI = NormalDist(0, SIGMA).cdf
IRF = np.diff([PHI(x) - exp(SIGMA**2 / (2 * DECAY**2) - x / DECAY) * PHI(x - SIGMA**2 / DECAY)
               for x in np.arange(-8, 24) - 0.5])
# How a driver may send t, the time after the gate's opening in bins; and its toa_offset_bins.
DRIVERS = {
    "words": (WAIT + 0.5, lambda t: np.floor(t).astype(np.uint16)),
    "floats from the first bin's centre": (WAIT + 0.5, lambda t: ((t - 0.5) % T).astype(np.float32)),
    "floats from its edge": (WAIT, lambda t: t.astype(np.float32)),
}
NEAR = 0.04                                   # bins: some four standard deviations of the mean of all photons' times
ROUGH = {"xcorr": 2 * NEAR, "rt3d": 2 * NEAR}     # they interpolate between bins: a parabola, a straight line


def make(driver: str, **changes) -> SensorModel:
    return SensorModel(ROWS, COLS, T, 250e-12, IRF, irf_ref=8, toa_offset_bins=DRIVERS[driver][0], **changes)


def observe(driver: str, range_m: float, photons: int) -> PhotonEvents:
    """Photons of a target at this range, timed with a clock that starts when the gate opens."""
    rng = np.random.default_rng(3)
    pixel = np.repeat(np.arange(ROWS * COLS, dtype=np.uint32), photons)
    t = 2 * range_m / 299_792_458 / 250e-12 - WAIT
    t += rng.normal(0, SIGMA, len(pixel)) + rng.exponential(DECAY, len(pixel))
    return PhotonEvents(pixel, DRIVERS[driver][1](t % T))


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
    shape = np.exp(-np.arange(T) / 20) + 0.05
    rng = np.random.default_rng(0)
    t = rng.choice(T, 200_000, p=shape / shape.sum()) + rng.random(200_000)
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
