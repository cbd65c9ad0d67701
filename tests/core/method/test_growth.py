"""Dim surfaces end at their outlines, and chance makes no blobs, on photons drawn here."""

import numpy as np
import pytest

from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.core.sketching.photon_frame import PhotonEvents

T, SIGMA, DEPTH = 1000, 4.0, 400.3
IRF = np.exp(-np.arange(-24, 25)**2 / (2 * SIGMA**2))


def cloud_of(where: np.ndarray, signal: float, background: float, seed: int, **options) -> PointCloud:
    """The cloud of a wall where `where` is true, of so many photons a pixel."""
    rng, pixels = np.random.default_rng(seed), where.size
    lit = np.repeat(np.arange(pixels), rng.poisson(signal * where).ravel())
    toa = np.rint(DEPTH + SIGMA * rng.standard_normal(len(lit))).astype(int)
    number = rng.poisson(background * pixels)
    pixel, toa = np.r_[lit, rng.integers(0, pixels, number)], np.r_[toa, rng.integers(0, T, number)]
    sensor = SensorModel(*where.shape, T, 1e-11, IRF)
    frequencies = choose_frequencies("auto", sensor)
    events = PhotonEvents(pixel.astype(np.uint32), toa.astype(np.uint16))
    return Pooled(sensor, frequencies, **options)(sketch_photons(events, sensor, frequencies))


@pytest.mark.parametrize(("sbr", "signal", "most"), [
    (np.inf, 0.1, 0.5), (np.inf, 0.5, 0.5), (10, 0.1, 1), (10, 0.5, 0.5), (1, 0.5, 1), (1, 0.1, 3)])
def test_a_dim_wall_ends_within_pixels_of_its_edge(sbr, signal, most):
    wall = np.arange(96) < 48
    beyond, missing = [], []
    for seed in (3, 4, 5):
        cloud = cloud_of(np.tile(wall, (80, 1)), signal, signal / sbr, seed)
        beyond.append((~wall[cloud.col]).sum() / 80)
        missing.append(20 - ((cloud.col >= 28) & (cloud.col < 48)).sum() / 80)
    assert np.mean(beyond) <= most and np.mean(missing) <= 0.2 / signal


def test_a_dim_object_does_not_fill_a_small_frame():
    row, col = np.mgrid[:24, :32]
    there = np.maximum(abs(row - 12), abs(col - 16)) <= 8
    clouds = [cloud_of(there, 0.05, 0.0005, seed) for seed in range(12)]
    false = np.mean([(~there[cloud.row, cloud.col]).sum() for cloud in clouds])
    assert false <= 0.15 * (~there).sum()


# Without `drop_blobs`, each of these frames shows a blob of 70 to 370 points.
@pytest.mark.parametrize(("ppp", "seed"), [(0.2, 0), (0.2, 29), (0.2, 42), (0.2, 72), (1, 12), (1, 121), (1, 285)])
def test_a_window_that_chance_has_filled_makes_no_blob(ppp, seed):
    rng = np.random.default_rng(seed)
    number = rng.poisson(ppp * 64 * 64)
    events = PhotonEvents(rng.integers(0, 64 * 64, number).astype(np.uint32),
                          rng.integers(0, T, number).astype(np.uint16))
    sensor = SensorModel(64, 64, T, 1e-11, IRF)
    frequencies = choose_frequencies("auto", sensor)
    pooled = Pooled(sensor, frequencies, false_alarm_rate=1e-3)
    assert len(pooled(sketch_photons(events, sensor, frequencies))) < 30
