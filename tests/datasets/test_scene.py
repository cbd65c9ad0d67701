"""The scenes that ship with the package, and scene files."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.projection import AngularScan
from srt3d_ros.datasets.simulation.bust import Bust, Figure, Part
from srt3d_ros.datasets.simulation.scene import NetScene, default_sensor, net_sensor, read_scene
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import InvalidInput


@pytest.fixture(scope="module")
def bust() -> Bust:
    return Bust(default_sensor())


def test_a_ball_is_hit_where_geometry_says():
    ball = Figure((Part((0, 0, 0), (10, 10, 10), 0.5),))
    origin = np.array([0, 0, -1], np.float32)
    sideways = np.linspace(0, 0.15, 50)
    rays = np.stack([sideways, 0 * sideways, np.ones(50)]).astype(np.float32)
    rays /= np.linalg.norm(rays, axis=0)
    along = rays[2].astype(np.float64)                          # |origin| = 1: nearest approach to the centre
    inside = along**2 - 1 + 0.1**2
    expected = np.where(inside > 0, along - np.sqrt(np.maximum(inside, 0)), np.inf)
    clear = np.abs(inside) > 1e-3                               # not the rays that graze it
    np.testing.assert_allclose(ball.march(origin, rays)[clear], expected[clear], atol=3e-4)


def test_the_bust_is_a_head_on_shoulders_before_a_wall(bust):
    range_m = bust.frame(0)[0][0]
    person = range_m < 2.35
    width = person.sum(axis=1)
    assert not person[0].any() and person[-1].all()             # wall above the head, shoulders across the bottom
    assert not person[:100, [0, -1]].any()                      # wall beside the head
    head, neck = width[60:70].max(), width[105:116].min()
    assert 55 < head < 80 and 25 < neck < head                  # a neck narrower than the head
    assert np.abs(person[20:110].astype(int) - person[20:110, ::-1]).mean() < 0.01     # looks straight ahead at t = 0


def test_the_head_turns_smoothly_well_within_the_sensors_window(bust):
    sensor, nose = default_sensor(), []
    for t_s in np.arange(2, 6, 0.25):
        range_m, reflectivity = bust.frame(t_s)
        bins = (range_m - sensor.range_m(0)) / sensor.bin_width_m
        assert 500 < bins.min() and bins.max() < sensor.num_bins - len(sensor.irf)
        assert range_m.dtype == reflectivity.dtype == np.float32
        assert 0 < reflectivity.min() and reflectivity.max() <= 1
        nose.append(np.unravel_index(np.argmin(range_m[0]), (141, 141))[1])
    assert max(nose) > 85 and min(nose) < 55 and np.abs(np.diff(nose)).max() <= 12


def test_the_bust_refuses_a_scanner():
    sensor = default_sensor().replace(projection=AngularScan(0, 0.01, 0, 0.01))
    with pytest.raises(InvalidInput, match="projection is angular_scan"):
        Bust(sensor)


def test_the_net_hangs_before_the_plane_and_waves():
    sensor = net_sensor()
    assert (sensor.rows, sensor.cols, sensor.num_bins) == (32, 32, 153)
    scene = NetScene(sensor)
    net, plane = scene.frame(0)[0]
    both = np.isfinite(net) & np.isfinite(plane)
    assert 0.5 < both.mean() < 1
    assert (plane[both] - net[both]).min() > 0.8
    later = scene.frame(1.0)[0]
    assert np.nanmax(np.abs(later[0] - net)) > 0.05
    np.testing.assert_array_equal(later[1], plane)


DEPTH_M = 4 + 0.3 * np.arange(48).reshape(6, 8) / 48


@pytest.fixture
def write(tmp_path):
    """Write a scene file; returns its path."""
    def call(**arrays):
        np.savez(tmp_path / "scene.npz", **arrays)
        return tmp_path / "scene.npz"
    return call


def test_the_sensor_sees_the_depths_of_the_file_in_the_middle_of_its_bins(write):
    depth_m, valid, seen = DEPTH_M.copy(), np.ones((6, 8), bool), np.ones((6, 8), bool)
    depth_m[0, :2] = 0, np.nan
    valid[2, 3] = False
    seen[0, :2] = seen[2, 3] = False
    scene, sensor = read_scene(write(depth_m=depth_m, reflectivity=np.full((6, 8), 0.5), valid=valid))
    depth, signal, _ = Simulator(scene, sensor, ppp=10).expected(0)
    assert (sensor.rows, sensor.cols, sensor.num_bins) == (6, 8, 4613)
    assert sensor.bin_width_m == pytest.approx(0.3e-3)
    np.testing.assert_allclose(sensor.range_m(depth[0][seen]), DEPTH_M[seen], atol=1e-5)
    assert np.isnan(depth[0][~seen]).all() and (signal[0][~seen] == 0).all()
    assert (scene.frame(0)[1][0] == np.where(seen, 0.5, 0)).all()
    assert np.nanmin(depth) + np.nanmax(depth) == pytest.approx(4613, abs=2)


def test_large_scenes_are_thinned_to_pixels_of_their_own(write):
    depth_m = 2 + np.random.default_rng(0).random((400, 600))
    scene, sensor = read_scene(write(depth_m=depth_m))
    range_m, reflectivity = scene.frame(0)
    assert (sensor.rows, sensor.cols) == range_m.shape[1:] == (94, 141)
    assert np.isin(range_m, depth_m.astype(np.float32)).all() and (reflectivity == 1).all()
    assert read_scene(write(depth_m=depth_m), size=30)[1].cols == 30


@pytest.mark.parametrize(("arrays", "named"), [
    ({"other": DEPTH_M}, "scene.npz depth_m is missing"), ({"depth_m": DEPTH_M[0]}, "scene.npz depth_m"),
    ({"depth_m": np.full((6, 8), "near")}, "scene.npz depth_m"), ({"depth_m": np.zeros((6, 8))}, "unknown everywhere"),
    ({"depth_m": DEPTH_M * np.linspace(1, 2, 8)}, "a span below 1.38 m"),
    ({"depth_m": DEPTH_M, "valid": np.ones((8, 6), bool)}, "scene.npz valid"),
    ({"depth_m": DEPTH_M, "reflectivity": np.full((6, 8), np.nan)}, "scene.npz reflectivity is negative or NaN")])
def test_what_cannot_be_used_is_named(write, arrays, named):
    with pytest.raises(InvalidInput, match=named):
        read_scene(write(**arrays))
