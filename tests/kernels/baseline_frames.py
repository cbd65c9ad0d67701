"""Sensors, photons and points on which the baselines' kernels are held against the reference, and when results agree.

float32 leaves depths in [0, 300) exact to 3e-5 bins; where points hang on small differences ten times that. Decisions
that rounding tells apart (a point on the border of a cluster, a projection that just goes on) may fall either way.
"""

import numpy as np

from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets.scene import StaticScene
from srt3d_ros.datasets.simulator import Simulator

T = 300
SHARE_AT_TIES = 1 / 100
SHAPES = [(8, 21), (1, 9), (9, 1), (1, 1)]


def make_sensor(rows, cols, irfs=1):
    rng = np.random.default_rng(rows)
    irf = np.exp(-np.linspace(-2, 4, 25)**2) * rng.uniform(0.8, 1, (irfs, 25))
    return SensorModel(rows, cols, T, 1e-10, irf if irfs > 1 else irf[0], gain=rng.uniform(0.5, 1.5, (rows, cols)),
                       delay_bins=rng.uniform(-3, 3, (rows, cols)), mask=rng.random((rows, cols)) > 0.05 * (cols > 1))


def make_points(rows, cols, surfaces, seed=0):
    """Points of two layers across the end of the period, some astray, some missing."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:rows, :cols]
    layers = np.stack([(290 + 0.6 * x - 0.4 * y) % T, 80 - 1.5 * y, np.full(x.shape, 150.0)][:surfaces], axis=1)
    size = layers.shape
    depth = np.where(rng.random(size) < 0.1, rng.uniform(0, T, size), layers + rng.normal(0, 1.5, size))
    intensity = np.where(rng.random(size) < 0.85, rng.uniform(1, 60, size), 0)
    return (depth % T).astype(np.float32), intensity.astype(np.float32)


def make_photons(sensor, ppp=25):
    y, x = np.mgrid[:sensor.rows, :sensor.cols]
    depth = np.stack([290 + 0.6 * x - 0.4 * y, 80 - 1.5 * y]) % T
    return Simulator(StaticScene(sensor.range_m(depth)), sensor, sbr=3, ppp=ppp, seed=1).frame(0)[0]


def assert_agree(fast, slow, exact_bins=3e-4, relative=3e-4):
    """Points are the same, but for ties; their depths and intensities agree."""
    (depth, intensity), (expected_depth, expected_intensity) = fast[:2], slow[:2]
    here, there = intensity > 0, expected_intensity > 0
    wrong = here != there
    wrong |= here & there & (np.abs(circular_difference(depth, expected_depth, T)) > exact_bins)
    wrong |= here & there & (np.abs(intensity - expected_intensity) > relative * expected_intensity)
    assert here.any() and wrong.sum() <= here.sum() * SHARE_AT_TIES, np.argwhere(wrong)
