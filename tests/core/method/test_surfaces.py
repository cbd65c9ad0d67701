"""Surfaces end at their outlines, steep ones are found, a wrong IRF leaves no second one; photons are drawn here."""

import numpy as np
import pytest

from tests.core.scenes import drawn

ROW, COL = np.mgrid[:32, :32]
WALL = 320.3 + 0.4 * ROW + 8 * np.sin(COL / 7)


# ---- A wrong IRF, and second surfaces that are there

@pytest.mark.parametrize("width", [0.9, 1, 1.1, 1.25])
def test_an_irf_of_another_width_leaves_no_second_surface(width):
    cloud = drawn([(WALL, 2000)], 20, 3.0, 5, width=width, surfaces=2)
    assert (cloud.surface > 0).sum() <= 0.02 * WALL.size
    first = cloud.surface == 0
    assert np.abs(cloud.depth_bins - WALL[cloud.row, cloud.col])[first].mean() < 0.1


@pytest.mark.parametrize("share", [0.04, 0.3, 1])
def test_glass_before_a_wall_stays(share):
    cloud = drawn([(WALL, 1000), (WALL - 60, 1000 * share)], 20, 3.0, 5, width=1.05, surfaces=2)
    near = np.abs(cloud.depth_bins - WALL[cloud.row, cloud.col] + 60) < 3
    assert near.sum() > 0.98 * WALL.size
    np.testing.assert_allclose(cloud.intensity[near].mean(), 1000 * share, rtol=0.1)


def test_a_halo_too_dim_for_second_surfaces_is_no_uneven_background():
    row, col = np.mgrid[:64, :64]
    far, wall = np.hypot(row - 32, col - 32), 420.3 + 0.3 * row
    reflector = np.where(far < 4, 50_000.0, 50 * np.exp((4 - far) / 12) * (far < 40))
    halo = [(wall, np.where(far < 4, 0.0, 50.0)), (np.full_like(wall, 270.3), reflector)]
    cloud = drawn(halo, 500, 4.0, 6, surfaces=2)
    near = np.abs(cloud.depth_bins - wall[cloud.row, cloud.col]) < 4
    assert near.sum() > 0.9 * wall.size


# ---- Outlines of dim surfaces, and blobs of chance

def dim(where: np.ndarray, signal: float, background: float, seed: int, **options):
    return drawn([(np.full(where.shape, 400.3), signal * where)], background, 4.0, seed, **options)


@pytest.mark.parametrize(("sbr", "signal", "most"), [
    (np.inf, 0.1, 0.5), (np.inf, 0.5, 0.5), (10, 0.1, 1), (10, 0.5, 0.5), (1, 0.5, 1), (1, 0.1, 3)])
def test_a_dim_wall_ends_within_pixels_of_its_edge(sbr, signal, most):
    wall = np.arange(96) < 48
    beyond, missing = [], []
    for seed in (3, 4, 5):
        cloud = dim(np.tile(wall, (80, 1)), signal, signal / sbr, seed)
        beyond.append((~wall[cloud.col]).sum() / 80)
        missing.append(20 - ((cloud.col >= 28) & (cloud.col < 48)).sum() / 80)
    assert np.mean(beyond) <= most and np.mean(missing) <= 0.2 / signal


def test_a_dim_object_does_not_fill_a_small_frame():
    row, col = np.mgrid[:24, :32]
    there = np.maximum(abs(row - 12), abs(col - 16)) <= 8
    clouds = [dim(there, 0.05, 0.0005, seed) for seed in range(12)]
    false = np.mean([(~there[cloud.row, cloud.col]).sum() for cloud in clouds])
    assert false <= 0.15 * (~there).sum()


# Without `drop_blobs`, each of these frames shows a blob of 70 to 370 points.
@pytest.mark.parametrize(("ppp", "seed"), [(0.2, 0), (0.2, 29), (0.2, 42), (0.2, 72), (1, 12), (1, 121), (1, 285)])
def test_a_window_that_chance_has_filled_makes_no_blob(ppp, seed):
    assert len(dim(np.zeros((64, 64)), 0.0, ppp, seed, false_alarm_rate=1e-3)) < 30


# ---- Steep surfaces: without `turn_planes`, all fail but one

@pytest.mark.parametrize(("slope", "fall"), [(10, 0), (12, 0), (0, 12), (9, -5), (30, 0), (35, 0)])
@pytest.mark.parametrize(("signal", "background"), [(1, 0.2), (5, 50)])
def test_a_steep_plane_is_found_where_it_is(slope, fall, signal, background):
    row, col = np.mgrid[:44, :44]
    depth = 230.3 + slope * col + fall * row
    cloud = drawn([(depth, signal)], background, 3.0, 7, 1800)
    error = abs(cloud.depth_bins - depth[cloud.row, cloud.col])
    near = error < 9 + (abs(slope) + abs(fall)) / 2
    assert near.sum() >= 0.995 * depth.size and (~near).sum() <= 0.005 * depth.size
    assert error[near].mean() <= 0.8
