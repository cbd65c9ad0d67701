"""The simulator: photons with the statistics that the model promises; a room, and ways through it."""

from itertools import islice, pairwise

import numpy as np
import pytest

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import AngularScan
from srt3d_ros.datasets.simulation.motion_profiles import OPTICAL, measured, walk
from srt3d_ros.datasets.simulation.moving import MovingView, moving_sensor
from srt3d_ros.datasets.simulation.room import FURNITURE, WALLS, Room
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import InvalidInput

T = 200
IRF = np.array([0.05, 0.4, 0.3, 0.15, 0.06, 0.04], np.float32)
SIGMAS = 5                  # fixed seeds: a right simulator passes always, a wrong one fails by far more


def make_sensor(rows=20, cols=30, **changes) -> SensorModel:
    return SensorModel(**({"rows": rows, "cols": cols, "num_bins": T, "bin_width_s": 1e-10, "irf": IRF} | changes))


def flat_scene(sensor: SensorModel, depth_bins: float, reflectivity=1.0) -> StaticScene:
    return StaticScene(np.full((sensor.rows, sensor.cols), sensor.range_m(depth_bins)), reflectivity)


def shifted_irf(depth_bins: float) -> np.ndarray:
    """h(x − t) by linear interpolation, wrapped."""
    whole, part = int(np.floor(depth_bins)), depth_bins - np.floor(depth_bins)
    padded = np.pad(IRF, (0, T - len(IRF)))
    return (1 - part) * np.roll(padded, whole - 1) + part * np.roll(padded, whole)


def chi_square_sigmas(counts: np.ndarray, expected: np.ndarray) -> float:
    """How many standard deviations the chi-square statistic of the counts lies above its mean."""
    sure = expected >= 5
    counts, expected = np.append(counts[sure], counts[~sure].sum()), np.append(expected[sure], expected[~sure].sum())
    counts, expected = counts[expected > 0], expected[expected > 0]
    chi2 = ((counts - expected) ** 2 / expected).sum()
    return (chi2 - len(counts)) / np.sqrt(2 * len(counts))


@pytest.mark.parametrize(("ppp", "sbr"), [(0.3, 2.0), (50.0, 0.1), (50.0, 20.0)])
def test_counts_of_pixels_are_poisson_with_mean_ppp_and_a_share_of_background(ppp, sbr):
    sensor = make_sensor(rows=80, cols=80)
    events, _ = Simulator(flat_scene(sensor, 80), sensor, sbr=sbr, ppp=ppp, seed=1).frame(0)
    counts = np.bincount(events.pixel, minlength=sensor.pixels)
    assert abs(counts.mean() - ppp) < SIGMAS * np.sqrt(ppp / sensor.pixels)
    assert counts.var() == pytest.approx(ppp, rel=SIGMAS * np.sqrt((2 + 1 / ppp) / sensor.pixels))
    far, background = (events.toa < 70) | (events.toa >= 95), ppp * sensor.pixels / (1 + sbr)
    assert abs(np.count_nonzero(far) - background * (T - 25) / T) < SIGMAS * np.sqrt(background)


@pytest.mark.parametrize("shape", [None, np.exp(-np.arange(T) / 40)], ids=["uniform", "shaped"])
def test_background_has_the_sensors_shape_later_where_pixels_are_late(shape):
    delay = np.where(np.arange(20) < 10, 0.0, 25.0)[:, None] * np.ones(30)
    sensor = make_sensor(background_shape=shape, delay_bins=delay)
    events, _ = Simulator(flat_scene(sensor, 80), sensor, sbr=1e-9, ppp=300, seed=4).frame(0)
    expected = np.ones(T) if shape is None else shape
    for late, rows in ((0, events.pixel < 300), (25, events.pixel >= 300)):
        seen, roll = np.bincount(events.toa[rows], minlength=T), np.roll(expected / expected.sum(), late)
        assert chi_square_sigmas(seen, roll * 300 * 300) < SIGMAS
    assert chi_square_sigmas(np.bincount(events.pixel, minlength=600), np.full(600, 300.0)) < SIGMAS


@pytest.mark.parametrize("depth_bins", [80.37, 0.2, 199.6])
def test_histogram_is_the_shifted_irf_wrapped_modulo_t(depth_bins):
    sensor = make_sensor()
    events, _ = Simulator(flat_scene(sensor, depth_bins), sensor, sbr=np.inf, ppp=1000, seed=5).frame(0)
    assert chi_square_sigmas(np.bincount(events.toa, minlength=T), 1000 * 600 * shifted_irf(depth_bins)) < SIGMAS


def test_returns_share_photons_by_reflectivity():
    sensor = make_sensor()
    range_m = np.stack([np.full((20, 30), sensor.range_m(40)), np.full((20, 30), sensor.range_m(120.5))])
    range_m[1, 0] = np.nan
    reflectivity = np.stack([np.full((20, 30), 1.0), np.full((20, 30), 3.0)])
    simulator = Simulator(StaticScene(range_m, reflectivity), sensor, sbr=np.inf, ppp=100, seed=7)
    events, truth = simulator.frame(0)
    near = events.toa < 80
    first_row = events.pixel < 30
    ratio = (~near & ~first_row).sum() / (near & ~first_row).sum()
    assert ratio == pytest.approx(3, rel=0.05)
    assert not (~near & first_row).any()
    assert np.isnan(truth[1, 0]).all() and np.isfinite(truth[1, 1:]).all()
    _, signal, background = simulator.expected(0)
    assert (signal.sum() + background.sum()) / sensor.pixels == pytest.approx(100)
    assert signal[1, 0].max() == 0 and signal[1, 5, 5] == pytest.approx(3 * signal[0, 5, 5])


def test_with_cycles_a_pixel_sees_the_first_photon_of_each():
    sensor = make_sensor(60, 60, cycles=50)
    events, _ = Simulator(flat_scene(sensor, 80), sensor, sbr=1.0, ppp=100.0, seed=3).frame(0)
    counts, cycles = np.bincount(events.pixel, minlength=sensor.pixels), sensor.cycles * sensor.pixels
    assert events.is_sorted and counts.max() <= 50
    for first, end, seen in ((0, 60, 1 - np.exp(-0.3)), (100, T, np.exp(-1.5) - np.exp(-2))):     # flux before them
        share = np.count_nonzero((events.toa >= first) & (events.toa < end)) / cycles
        assert abs(share - seen) < SIGMAS * np.sqrt(seen * (1 - seen) / cycles)


def test_after_a_photon_a_pixel_is_blind_for_a_long_dead_time():
    sensor = make_sensor(60, 60, cycles=200)
    dead = sensor.replace(dead_time_s=2.5 * T * sensor.bin_width_s)
    seen, detected = (Simulator(flat_scene(one, 80), one, sbr=1.0, ppp=400.0, seed=3).frame(0)[0]
                      for one in (sensor, dead))
    # A renewal process: one photon per dead time and mean wait, T / 2 at 2 photons a cycle.
    assert detected.is_sorted and detected.photons / sensor.pixels == pytest.approx(200 / (2.5 + 0.5), rel=0.02)
    assert np.bincount(detected.pixel).max() <= 81 and seen.photons > 2 * detected.photons


def test_gain_and_mask_of_the_sensor_are_obeyed():
    gain, mask = np.where(np.arange(30) < 15, 0.5, 2.0) * np.ones((20, 1)), np.ones((20, 30), bool)
    mask[:, 7] = False
    sensor = make_sensor(gain=gain, mask=mask)
    events, truth = Simulator(flat_scene(sensor, 80), sensor, sbr=100, ppp=200, seed=8).frame(0)
    counts = np.bincount(events.pixel, minlength=600).reshape(20, 30)
    assert counts[:, 7].max() == 0 and events.photons == pytest.approx(200 * mask.sum(), rel=0.02)
    assert counts[:, 15:].mean() / counts[:, :7].mean() == pytest.approx(4, rel=0.03)
    np.testing.assert_allclose(truth, 80, atol=1e-3)


def test_an_irf_per_pixel_and_its_delay_are_obeyed():
    irf = np.stack([np.roll(np.pad(IRF, (0, 10)), p % 10) for p in range(600)])
    sensor = make_sensor(irf=irf, irf_ref=1, delay_bins=np.full((20, 30), 20.0))
    events, _ = Simulator(flat_scene(sensor, 80.5), sensor, sbr=np.inf, ppp=300, seed=9).frame(0)
    for roll in (0, 4, 9):
        counts = np.bincount(events.toa[events.pixel % 10 == roll], minlength=T)
        assert chi_square_sigmas(counts, 300 * 60 * shifted_irf(100.5 + roll)) < SIGMAS


def test_a_frame_depends_on_seed_and_index_alone_is_sorted_and_fits_its_sensor():
    first, again, other = (Simulator(ppp=3, seed=seed) for seed in (3, 3, 4))
    earlier = first.frame(1)[0]
    (events, truth), (same, same_truth) = first.frame(7), again.frame(7)
    for one, two in ((events.pixel, same.pixel), (events.toa, same.toa), (truth, same_truth)):
        np.testing.assert_array_equal(one, two)
    for another in (earlier, other.frame(7)[0]):
        assert not np.array_equal(another.toa, events.toa)
    events.check(first.sensor)
    assert (first.sensor.rows, first.sensor.cols, first.sensor.num_bins) == (141, 141, 4613)
    assert events.is_sorted and events.toa.dtype == np.uint16 and events.stamp_ns == 700_000_000
    assert np.isfinite(truth).all() and truth.shape == (1, 141, 141)


@pytest.mark.parametrize(("field", "changes"), [
    ("projection", {"scene": None, "sensor": make_sensor(projection=AngularScan(0, 0.01, 0, 0.01))}),
    ("sbr", {"sbr": float("nan")}), ("ppp", {"ppp": 1e9}), ("seed", {"seed": 0.5}),
    ("scene", {"scene": StaticScene(np.full((20, 30), 5.0), 0)}),
    ("scene shape", {"scene": StaticScene(np.full((20, 31), 5.0))}),
    ("reflectivity", {"scene": StaticScene(np.full((20, 30), 5.0), -1)})])
def test_bad_arguments_are_named(field, changes):
    sensor = make_sensor()
    with pytest.raises(InvalidInput) as caught:
        Simulator(**({"scene": flat_scene(sensor, 80), "sensor": sensor} | changes))
    assert caught.value.field == field


SENSOR = moving_sensor(side=31)


def rays_to(points, origin) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors float32 [3, N] to points [N, 3], and the distances."""
    way = np.asarray(points, float) - origin
    distance = np.linalg.norm(way, axis=1)
    return np.ascontiguousarray((way / distance[:, None]).T, dtype=np.float32), distance


def test_a_static_world_stays_where_it_is_while_the_sensor_moves():
    view = MovingView(Room(), walk, SENSOR)
    for t_s in (0.0, 0.7, 5.3):
        range_m, _ = view.at(t_s)
        points = view.sensor_pose(t_s)((SENSOR.rays * range_m[..., None]).reshape(-1, 3))
        inside = np.abs(points - WALLS.middle) - np.array(WALLS.size) / 2
        assert inside.max() < 1e-5
        other = view.sensor_pose(t_s + 0.05)
        rays, distance = rays_to(points, other.translation)
        again, _ = Room().cast(other.translation, rays)
        assert np.median(np.abs(again - distance)) < 1e-5       # some are hidden now
        assert (again < distance + 1e-3).all()


def test_a_walk_is_smooth_and_keeps_away_from_walls_and_furniture():
    step_s = 0.01
    poses = [walk(t) for t in np.arange(0, 60, step_s)]
    steps = [before.inverse() @ after for before, after in pairwise(poses)]
    velocity = np.array([step.translation for step in steps]) / step_s
    turn = np.array([step.rotation_vector for step in steps]) / step_s
    assert np.linalg.norm(velocity, axis=1).max() < 1.3 and np.degrees(np.linalg.norm(turn, axis=1)).max() < 45
    assert np.abs(np.diff(velocity, axis=0)).max() < 5 * step_s and np.abs(np.diff(turn, axis=0)).max() < 2 * step_s
    for box in FURNITURE:
        to_box = Pose(Pose.turned([0, 0, np.radians(box.yaw_deg)]).rotation, np.array(box.middle)).inverse()
        outside = np.abs(to_box(np.array([pose.translation for pose in poses[::10]]))) - np.array(box.size) / 2
        assert (outside.max(axis=1) > 0.2).all(), box
    assert np.abs([pose.translation[:2] for pose in poses]).max() < 2.5


def test_odometry_is_exact_and_its_velocity_holds_until_the_next_report():
    reports = list(islice(measured(walk, 50.0, start_s=1.0), 20))
    for report, after in pairwise(reports):
        np.testing.assert_array_equal(report.pose.translation, walk(report.at_s).translation)
        step = Pose(Pose.turned(report.rate_rad_s / 50).rotation, report.velocity_m_s / 50)
        np.testing.assert_allclose((report.pose @ step).translation, after.pose.translation, atol=1e-12)
        np.testing.assert_allclose((report.pose @ step).rotation, after.pose.rotation, atol=1e-12)


def test_the_truth_of_a_frame_is_that_of_its_middle():
    view = MovingView(Room(), walk, SENSOR, exposure_s=0.01)
    _, truth = Simulator(view, SENSOR, ppp=3, seed=5, frame_rate_hz=100.0).frame(7)
    np.testing.assert_allclose(SENSOR.range_m(truth[0]), view.at(0.075)[0], rtol=1e-5)
    assert np.array_equal(view.sensor_pose(1.0).rotation, (walk(1.0) @ OPTICAL).rotation)
