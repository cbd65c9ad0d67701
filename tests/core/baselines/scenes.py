"""Sensors, scenes and photons that the tests of the baselines share."""

import numpy as np

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.methods import METHODS, reconstruct
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets.scene import StaticScene
from srt3d_ros.datasets.simulator import Simulator

BASELINES = ("srt3d", "smle", "xcorr", "rt3d")
T = 586
IRF = np.exp(-0.5 * ((np.arange(40) - 15) / np.where(np.arange(40) < 15, 3, 5))**2)     # steep rise, slow decay

# A peak with a long tail, as measured ones have: only there it matters how the parts of a sketch are weighted.
TAILED = np.exp(-0.5 * ((np.arange(120) - 12) / 3)**2) + 0.12 * np.exp(-np.maximum(np.arange(120) - 12, 0) / 25)


def make_sensor(rows: int, cols: int, **changes) -> SensorModel:
    return SensorModel(rows, cols, T, 16e-12, **({"irf": IRF} | changes))


def ramp(rows: int, cols: int, start: float, per_col: float, per_row: float) -> np.ndarray:
    y, x = np.mgrid[:rows, :cols]
    return start + per_col * x + per_row * y


def simulate(depth_bins: np.ndarray, sbr: float, ppp: float, sensor=None, seed=0) -> PhotonEvents:
    """Photons of surfaces at these depths, [rows, cols] or [S, rows, cols]."""
    sensor = sensor or make_sensor(*depth_bins.shape[-2:])
    return Simulator(StaticScene(sensor.range_m(depth_bins)), sensor, sbr=sbr, ppp=ppp, seed=seed).frame(0)[0]


def background_alone(sensor: SensorModel, ppp: float, seed: int) -> PhotonEvents:
    rng = np.random.default_rng(seed)
    count = rng.poisson(ppp * sensor.pixels)
    return PhotonEvents(np.sort(rng.integers(0, sensor.pixels, count)).astype(np.uint32),
                        rng.integers(0, sensor.num_bins, count).astype(np.uint16))


def run(name: str, frame, sensor: SensorModel, sketch_size: int = 10, **options):
    """The cloud by a method with its own frequencies."""
    m = min(sketch_size, max((sensor.num_bins - 1) // 2, 1))
    return reconstruct(name, frame, sensor, choose(METHODS[name].frequencies, sensor, m), **options)


def errors(cloud, depth_bins: np.ndarray) -> np.ndarray:
    """Of each point from the depth of its pixel, bins."""
    return circular_difference(cloud.depth_bins.astype(np.float64), depth_bins[cloud.row, cloud.col], T)


def assert_finite(cloud):
    for name in ("depth_bins", "intensity", "depth_std_bins", "xyz", "background"):
        assert np.isfinite(getattr(cloud, name)).all(), name
    assert (cloud.intensity > 0).all() and (cloud.depth_std_bins > 0).all() and (cloud.background >= 0).all()
    assert (cloud.depth_bins >= 0).all()
