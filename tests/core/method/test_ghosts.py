"""A wrong IRF leaves no second surface, and a second surface that is there stays."""

import numpy as np
import pytest

from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.core.sketching.photon_frame import PhotonEvents

SIDE, T, SIGMA = 32, 1000, 3.0
ROW, COL = np.mgrid[:SIDE, :SIDE]
WALL = 320.3 + 0.4 * ROW + 8 * np.sin(COL / 7)


def cloud_of(surfaces: list[tuple[np.ndarray, np.ndarray | float]], width: float, background: int = 20) -> PointCloud:
    """The cloud with up to two surfaces a pixel of surfaces (depth, photons), with an IRF so many times as wide."""
    rng, (rows, cols) = np.random.default_rng(5), surfaces[0][0].shape
    pixels = rows * cols
    pixel, toa = [rng.integers(0, pixels, background * pixels)], [rng.integers(0, T, background * pixels)]
    for depth, photons in surfaces:
        lit = np.repeat(np.arange(pixels), rng.poisson(np.broadcast_to(photons, (rows, cols)).ravel()))
        pixel.append(lit)
        toa.append(np.rint(depth.ravel()[lit] + SIGMA * rng.standard_normal(len(lit))).astype(int))
    irf = np.exp(-np.arange(-25, 26)**2 / (2 * (SIGMA * width)**2))
    sensor = SensorModel(rows, cols, T, 1e-11, irf)
    frequencies = choose_frequencies("auto", sensor)
    events = PhotonEvents(np.concatenate(pixel).astype(np.uint32), np.concatenate(toa).astype(np.uint16))
    return Pooled(sensor, frequencies, surfaces=2)(sketch_photons(events, sensor, frequencies))


@pytest.mark.parametrize("width", [0.9, 1, 1.1, 1.25])
def test_an_irf_of_another_width_leaves_no_second_surface(width):
    cloud = cloud_of([(WALL, 2000)], width)
    assert (cloud.surface > 0).sum() <= 0.02 * SIDE * SIDE
    first = cloud.surface == 0
    assert np.abs(cloud.depth_bins - WALL[cloud.row, cloud.col])[first].mean() < 0.1


@pytest.mark.parametrize("share", [0.04, 0.3, 1])
def test_glass_before_a_wall_stays(share):
    cloud = cloud_of([(WALL, 1000), (WALL - 60, 1000 * share)], 1.05)
    near = np.abs(cloud.depth_bins - WALL[cloud.row, cloud.col] + 60) < 3
    assert near.sum() > 0.98 * SIDE * SIDE
    np.testing.assert_allclose(cloud.intensity[near].mean(), 1000 * share, rtol=0.1)


def test_a_halo_too_dim_for_second_surfaces_is_no_uneven_background(monkeypatch):
    monkeypatch.setattr("tests.core.method.test_ghosts.SIGMA", 4.0)
    row, col = np.mgrid[:64, :64]
    far, wall = np.hypot(row - 32, col - 32), 420.3 + 0.3 * row
    reflector = np.where(far < 4, 50_000.0, 50 * np.exp((4 - far) / 12) * (far < 40))
    cloud = cloud_of([(wall, np.where(far < 4, 0.0, 50.0)), (np.full_like(wall, 270.3), reflector)], 1, background=500)
    near = np.abs(cloud.depth_bins - wall[cloud.row, cloud.col]) < 4
    assert near.sum() > 0.9 * wall.size
