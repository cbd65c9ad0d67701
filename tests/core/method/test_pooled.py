"""What pooled does beyond what every method must do (test_methods.py)."""

import numpy as np
import pytest

from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from tests.core.scenes import T, background_alone, drawn, errors, exact, make_sensor, pooled, ramp, simulate

# ---- Without noise

@pytest.mark.parametrize(("start", "per_col", "per_row"), [
    (200.3, 0, 0), (200.3, 2, -1.4), (200.3, 5, -3.5), (T - 12.5, 0.6, 0.2)])
def test_a_tilted_plane_is_found_to_a_tenth_of_a_bin_up_to_its_borders(start, per_col, per_row, signal=20.0):
    depth = ramp(24, 40, start, per_col, per_row) % T
    cloud = pooled(exact(make_sensor(24, 40), depth, signal), make_sensor(24, 40))
    assert len(cloud) == depth.size and np.abs(errors(cloud, depth)).max() < 0.1
    np.testing.assert_allclose(cloud.intensity, signal, rtol=0.01)
    assert cloud.background.max() < 0.01 * signal


# ---- With photons

@pytest.mark.parametrize(("gap", "ppp", "sbr"), [(20, 10, 10), (60, 10, 1), (200, 100, 10)])
def test_at_a_step_edge_no_points_fly(gap, ppp, sbr):
    depth = np.where(np.arange(64) < 32, 200.0, 200.0 + gap) + np.zeros((48, 1))
    cloud = pooled(simulate(depth, sbr, ppp), make_sensor(*depth.shape))
    assert (np.abs(errors(cloud, [200, 200 + gap])) > 10).mean() <= 0.001
    assert (np.abs(errors(cloud, depth)) > 10).mean() <= 0.005           # and nearly all are on their own side
    assert len(cloud) >= 0.999 * depth.size


@pytest.mark.parametrize(("depth", "sbr", "frames"), [
    (np.full((8, 8), 200.3), 1, 60), (ramp(64, 64, 200.3, 0.1, -0.2), 1, 4), (ramp(64, 64, 200.3, 0, 0), 0.1, 12),
    (np.where(np.arange(48) < 24, 200.3, 260.3) + np.zeros((48, 1)), 1, 6)], ids=["small", "slope", "plane", "step"])
def test_depth_errors_are_as_large_as_points_claim(depth, sbr, frames):
    clouds = [pooled(simulate(depth, sbr, 10, seed=seed), make_sensor(*depth.shape)) for seed in range(frames)]
    error = np.concatenate([np.abs(errors(cloud, depth)) / cloud.depth_std_bins for cloud in clouds])
    assert 0.6 <= (error <= 1).mean() <= 0.76 and 0.92 <= (error <= 2).mean() <= 0.975


# ---- Background alone

@pytest.mark.parametrize(("m", "rate", "ppp"), [(5, 1e-3, 100), (10, 1e-3, 5), (10, 1e-2, 0.3), (40, 1e-3, 0.02)])
def test_background_alone_shows_few_points(m, rate, ppp):
    sensor, frames = make_sensor(64, 64), 20
    points = [len(pooled(background_alone(sensor, ppp, seed), sensor, m, false_alarm_rate=rate))
              for seed in range(frames)]
    # A false point comes with its window's 120 to 430 pixels, so that counts scatter: 4 times the rate, or 4 of them.
    # Where few photons meet narrow pulses, chance meetings pass for surfaces more often.
    times = 16 if ppp < 0.1 and m == 40 else 4
    assert sum(points) <= max(times * rate * frames * sensor.pixels, 4 * 120)


# ---- Bias: a flat surface is neither too near nor too far, whatever the IRF's shape and the place in the bin

TAILED = np.convolve(np.exp(-0.5 * np.arange(-8, 9)**2), np.exp(-np.arange(32) / 4))       # a tail of 4 bins
IRFS = {"least driver": [0.1, 0.8, 1, 0.6, 0.2], "slow decay": TAILED, "slow rise": TAILED[::-1]}


def best_depth(toa: np.ndarray, irf: np.ndarray, ref: int, frequencies, num_bins: int, near: float) -> float:
    """The depth at which the data term ‖n z − r ĥ exp(i ω t)‖² of all photons together is least, in float64."""
    omega = 2 * np.pi * np.array(frequencies) / num_bins
    response = np.exp(1j * np.outer(omega, np.arange(len(irf)) - ref)) @ irf
    total = np.exp(1j * np.outer(omega, np.arange(num_bins))) @ np.bincount(toa, minlength=num_bins)
    for _ in range(8):                                              # Newton's steps
        along = np.conj(response) * total * np.exp(-1j * omega * near)
        near += (omega * along.imag).sum() / (omega**2 * along.real).sum()
    return near


@pytest.mark.parametrize("irf", IRFS.values(), ids=IRFS)
def test_the_mean_depth_of_a_flat_surface_is_that_of_all_its_photons_together(irf):
    sensor = SensorModel(32, 32, 300, 1e-10, irf)
    frequencies = choose_frequencies("auto", sensor, 10)
    method, off, true_off = Pooled(sensor, frequencies, device="cpu"), [], []
    for k, depth in enumerate(150 + np.arange(8) / 8):
        frame = simulate(np.full((32, 32), depth), np.inf, 50, sensor, seed=k)
        cloud = method(sketch_photons(frame, sensor, frequencies))
        assert len(cloud) == sensor.pixels
        own = best_depth(frame.toa, sensor.irf.astype(float), sensor.irf_ref, frequencies, sensor.num_bins, depth)
        off.append(cloud.depth_bins.mean(dtype=float) - own)
        true_off.append(own - depth)
    assert abs(np.mean(off)) < 0.01                                 # bins; they were 0.003 at most
    assert abs(np.mean(true_off)) < 0.01                            # two standard deviations


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


# In turns, two equal surfaces 3 σ apart are 5 bins off at any light; where they count as one, half of these are lost.
@pytest.mark.parametrize(("gap", "share", "light", "least"), [
    (9, 0.25, 20, 0.95), (12, 0.25, 20, 0.97), (12, 1, 200, 0.95), (9, 1, 200, 0.85)])
def test_two_surfaces_whose_pulses_overlap_are_told_apart(gap, share, light, least):
    cloud = drawn([(WALL, light), (WALL + gap, light * share)], light / 5, 3.0, 5, surfaces=2)
    off = cloud.depth_bins - WALL[cloud.row, cloud.col]
    assert min((np.abs(off - at) < 2).sum() for at in (0, gap)) > least * WALL.size


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


# Without `drop_blobs`, each of these frames shows a blob of 70 to 370 points; the large ones also without BLOB_STARTS.
@pytest.mark.parametrize(("side", "ppp", "seed"), [
    (64, 0.2, 0), (64, 0.2, 29), (64, 0.2, 42), (64, 0.2, 72), (64, 1, 12), (64, 1, 121), (64, 1, 285),
    (256, 0.2, 46), (256, 1, 41), (256, 1, 147)])
def test_a_window_that_chance_has_filled_makes_no_blob(side, ppp, seed):
    assert len(dim(np.zeros((side, side)), 0.0, ppp, seed, false_alarm_rate=1e-3)) < 30


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
