"""Windows of a moving sensor: sums, photons and exposure of each pixel, wherever it looks."""

from dataclasses import replace

import numpy as np
import pytest

from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.motion.trajectory import Pose, Trajectory
from srt3d_ros.core.motion.window import MovingWindow
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import AngularScan, Pinhole
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import InvalidInput
from srt3d_ros.reconstruction import Reconstructor
from tests.core.scenes import simulate, through

ROWS, COLS, T, STEP, MS = 4, 12, 200, 0.02, 1_000_000
FREQUENCIES = (1, 3, 20)
SENSOR = SensorModel(ROWS, COLS, T, 1e-10, [1, 2, 1], projection=AngularScan(0.1, -STEP, 0.1, -STEP))


def seen(depth, photons: int, stamp_ns: int = 0, sensor: SensorModel = SENSOR, **more) -> PhaseSums:
    """So many photons in each pixel, all at one depth."""
    depth = np.broadcast_to(depth, (sensor.rows, sensor.cols))
    phases = np.exp(2j * np.pi * depth[..., None] * np.array(FREQUENCIES) / T)
    return PhaseSums(FREQUENCIES, photons * phases, np.full(depth.shape, photons), stamp_ns, sensor=sensor, **more)


def each_100_ms(*poses: Pose) -> Trajectory:
    return through((100 * k * MS, pose) for k, pose in enumerate(poses))


def test_at_rest_a_window_counts_as_many_frames_as_it_has():
    window = MovingWindow(SENSOR, FREQUENCIES, 5)
    found = [window(seen(40, 9), None, None) for _ in range(30)]
    assert (found[0].exposure == 1).all() and (found[0].photons == 9).all()
    assert 1.5 < found[1].exposure[0, 0] < found[2].exposure[0, 0] < found[-1].exposure[0, 0]
    np.testing.assert_allclose(found[-1].exposure, 5, rtol=1e-4)
    assert abs(int(found[-1].photons.sum()) - 5 * 9 * SENSOR.pixels) < SENSOR.pixels / 4
    np.testing.assert_allclose(found[-1].z, seen(40, 9).z, atol=1e-5)


def test_the_variance_of_a_window_is_that_of_its_photons():
    """So the thresholds of single frames hold."""
    rng, window, sensor = np.random.default_rng(0), MovingWindow(SENSOR, FREQUENCIES, 8), SENSOR
    for _ in range(40):
        counts = rng.poisson(20, (ROWS, COLS))
        phases = rng.uniform(0, 2 * np.pi, (ROWS, COLS, 3))
        found = window(PhaseSums(FREQUENCIES, np.sqrt(counts)[..., None] * np.exp(1j * phases), counts, sensor=sensor),
                       None, None)
    assert np.square(np.abs(found.sums)).mean() == pytest.approx(found.photons.mean(), rel=0.25)


def test_what_comes_into_view_has_been_seen_by_fewer_frames_also_where_there_are_no_photons():
    window, dark = MovingWindow(SENSOR, FREQUENCIES, 9), np.arange(ROWS)[:, None, None] == 0
    trajectory = each_100_ms(*(Pose.turned([0, 0, -STEP * k]) for k in range(4)))       # to the right by a column
    for k in range(4):
        sketch = seen(40, 900, 100 * k * MS)
        sketch = replace(sketch, sums=sketch.sums * ~dark, photons=sketch.photons * ~dark[..., 0])
        found = window(sketch, trajectory, None)
    assert (np.diff(found.exposure[:, :-4], axis=1) == 0).sum() < ROWS * COLS
    columns = found.exposure.mean(axis=0)
    np.testing.assert_allclose(found.exposure, np.broadcast_to(columns, (ROWS, COLS)), rtol=1e-3)
    assert columns[-1] == pytest.approx(1) and np.all(np.diff(columns[-4:]) < -0.3) and columns[3] > 3.5
    np.testing.assert_allclose(found.photons[1:] / found.exposure[1:], 900, rtol=0.01)
    assert not found.photons[0].any()


@pytest.mark.parametrize("given", [True, False])
def test_the_last_cloud_tells_how_far_photons_move(given):
    """A wall at 2 m, and a step to the left that moves it by two columns; without a cloud it counts as farther."""
    sensor = SENSOR.replace(rows=9, projection=Pinhole(40, 40, 5.5, 4))
    rays = sensor.rays
    depth = sensor.depth_bins(2 / rays[..., 2])
    wall = PointCloud.from_layers(sensor, depth[:, None], np.ones((9, 1, COLS), np.float32), np.zeros((9, COLS)), 0)
    marked = seen(depth, 0, sensor=sensor)
    marked.photons[4, 5], marked.sums[4, 5] = 100, 100 * np.exp(2j * np.pi * depth[4, 5] * np.array(FREQUENCIES) / T)
    window = MovingWindow(sensor, FREQUENCIES, 3)
    window(marked, None, None)
    found = window(seen(depth, 0, 100 * MS, sensor), each_100_ms(Pose(), Pose(translation=np.array([-0.1, 0, 0]))),
                   wall if given else None)
    place = np.unravel_index(found.photons.argmax(), found.photons.shape)
    assert (place == (4, 7)) == given
    if given:
        expected = np.exp(2j * np.pi * depth[4, 7] * np.array(FREQUENCIES) / T)
        np.testing.assert_allclose(found.z[4, 7], expected, atol=0.02)


@pytest.mark.parametrize(("stamps_ms", "poses"), [((0, 100), 1), ((100, 0), 2), ((0, 0), 2)])
def test_a_window_ends_where_the_trajectory_or_time_does(stamps_ms, poses):
    window, trajectory = MovingWindow(SENSOR, FREQUENCIES, 9), each_100_ms(*[Pose()] * poses)
    for ms in stamps_ms:
        found = window(seen(40, 9, ms * MS), trajectory, None)
        assert (found.exposure == 1).all() and (found.photons == 9).all()


def test_cycles_and_photons_before_the_gate_are_those_of_the_exposure():
    window, trajectory = MovingWindow(SENSOR, FREQUENCIES, 4), each_100_ms(Pose(), Pose())
    for k in range(2):
        found = window(seen(40, 9, 100 * k * MS, cycles=50, before=np.full((ROWS, COLS), 30, np.uint32)), trajectory,
                       None)
    np.testing.assert_allclose(found.armed_cycles, 20 * found.exposure, atol=1)
    with pytest.raises(InvalidInput, match="Windows do not add"):
        found + found


def test_frames_with_and_without_photons_before_a_gate_do_not_mix():
    window, gated = MovingWindow(SENSOR, FREQUENCIES, 4), {"cycles": 50, "before": np.full((ROWS, COLS), 30, np.uint32)}
    found = [window(seen(40, 9, **more), None, None) for more in (gated, gated, {}, {}, gated, gated)]
    assert [(one.exposure > 1).all() for one in found] == [False, True] * 3
    assert [one.before is not None for one in found] == [True, True, False, False, True, True]


@pytest.mark.parametrize("cycles", [None, 12])
def test_clouds_of_a_window_have_more_points_and_the_photons_of_one_frame(cycles):
    """A slanted wall of few photons, with pile-up or without; half of the pixels have twice the gain."""
    gain = np.where(np.arange(32) % 2, 2, 1) * np.ones((32, 1))
    sensor = SensorModel(32, 32, T, 1e-10, np.exp(-0.5 * ((np.arange(9) - 4) / 1.5)**2), gain=gain, cycles=cycles)
    range_m = np.linspace(1, 1.4, 32) * np.ones((32, 1))
    simulator = Simulator(StaticScene(range_m.astype(np.float32), np.ones((32, 32), np.float32)), sensor, 1.0, 4.0)
    signal, background = (values.mean() / 1.5 for values in simulator.expected(0)[1:])
    single, windowed = Pooled(sensor, FREQUENCIES), Pooled(sensor, FREQUENCIES, window_frames=10)
    trajectory = each_100_ms(*[Pose()] * 20)
    for k in range(20):
        sketch = replace(sketch_photons(simulator.frame(k)[0], sensor, FREQUENCIES), stamp_ns=100 * k * MS)
        one, cloud = single(sketch), windowed(sketch, trajectory)
    truth = simulator.frame(0)[1][0]
    errors = [np.median(np.abs(each.depth_bins - truth[each.row, each.col])) for each in (one, cloud)]
    assert errors[1] < 0.7 * errors[0] and len(cloud) >= len(one)
    assert np.median(cloud.intensity) == pytest.approx(signal, rel=0.08)
    assert np.median(cloud.background / gain) == pytest.approx(background, rel=0.08)


def test_a_window_that_moves_keeps_the_light_of_one_frame_on_a_steep_wall():
    """A wall that recedes by some bins a pixel, of which a pixel or so passes in each frame."""
    sensor = SensorModel(48, 48, T, 1e-10, np.exp(-0.5 * ((np.arange(9) - 4) / 1.5)**2),
                         projection=Pinhole(60, 60, 23.5, 23.5))
    pooled, trajectory, light = Pooled(sensor, FREQUENCIES, window_frames=10), Trajectory(), []
    for k in range(16):
        x_m = 0.02 * k
        range_m = (1 + x_m) / (sensor.rays[..., 2] - sensor.rays[..., 0])          # z = 1 + x
        trajectory.add(100 * k * MS, Pose(translation=np.array([x_m, 0, 0])))
        sketch = sketch_photons(simulate(sensor.depth_bins(range_m), 1.0, 8.0, sensor, k), sensor, FREQUENCIES)
        cloud = pooled(replace(sketch, stamp_ns=100 * k * MS), trajectory)
        inside = (cloud.row > 5) & (cloud.row < 42) & (cloud.col > 5) & (cloud.col < 36)
        light.append((np.median(cloud.intensity[inside]), np.median(cloud.background)))
    np.testing.assert_allclose(np.mean(light[8:], axis=0), 4, rtol=0.05)


def test_only_windows_take_a_trajectory():
    with pytest.raises(InvalidInput, match="Only windows follow a trajectory"):
        Reconstructor(SENSOR, FREQUENCIES, device="cpu")(seen(40, 9), Trajectory())
