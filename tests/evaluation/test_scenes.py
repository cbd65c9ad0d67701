"""The scenes that are evaluated on, and scene files."""

import numpy as np
import pytest

from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import InvalidInput
from srt3d_ros.evaluation.scenes import NetScene, net_sensor, read_scene

DEPTH_M = 4 + 0.3 * np.arange(48).reshape(6, 8) / 48


@pytest.fixture
def write(tmp_path):
    """Write a scene file; returns its path."""
    def call(**arrays):
        np.savez(tmp_path / "scene.npz", **arrays)
        return tmp_path / "scene.npz"
    return call


def test_the_net_hangs_before_the_plane_and_waves():
    scene = NetScene(net_sensor())
    net, plane = scene.frame(0)[0]
    both = np.isfinite(net) & np.isfinite(plane)
    assert 0.5 < both.mean() < 1 and (plane[both] - net[both]).min() > 0.8
    later = scene.frame(1.0)[0]
    assert np.nanmax(np.abs(later[0] - net)) > 0.05 and np.array_equal(later[1], plane, equal_nan=True)


def test_the_sensor_sees_the_depths_of_the_file_in_the_middle_of_its_bins(write):
    depth_m, valid, seen = DEPTH_M.copy(), np.ones((6, 8), bool), np.ones((6, 8), bool)
    depth_m[0, :2] = 0, np.nan
    valid[2, 3] = False
    seen[0, :2] = seen[2, 3] = False
    scene, sensor = read_scene(write(depth_m=depth_m, reflectivity=np.full((6, 8), 0.5), valid=valid))
    depth, signal, _ = Simulator(scene, sensor, ppp=10).expected(0)
    assert (sensor.rows, sensor.cols, sensor.num_bins) == (6, 8, 4613)
    np.testing.assert_allclose(sensor.range_m(depth[0][seen]), DEPTH_M[seen], atol=1e-5)
    assert np.isnan(depth[0][~seen]).all() and (scene.frame(0)[1][0] == np.where(seen, 0.5, 0)).all()
    assert np.nanmin(depth) + np.nanmax(depth) == pytest.approx(4613, abs=2)


def test_large_scenes_are_thinned_to_pixels_of_their_own(write):
    depth_m = 2 + np.random.default_rng(0).random((400, 600))
    scene, sensor = read_scene(write(depth_m=depth_m))
    range_m, reflectivity = scene.frame(0)
    assert (sensor.rows, sensor.cols) == range_m.shape[1:] == (94, 141)
    assert np.isin(range_m, depth_m.astype(np.float32)).all() and (reflectivity == 1).all()


@pytest.mark.parametrize(("arrays", "named"), [
    ({"other": DEPTH_M}, "scene.npz depth_m is missing"), ({"depth_m": np.full((6, 8), "near")}, "scene.npz depth_m"),
    ({"depth_m": np.zeros((6, 8))}, "unknown everywhere"), ({"depth_m": DEPTH_M * np.linspace(1, 2, 8)}, "span below"),
    ({"depth_m": DEPTH_M, "valid": np.ones((8, 6), bool)}, "scene.npz valid"),
    ({"depth_m": DEPTH_M, "reflectivity": np.full((6, 8), np.nan)}, "scene.npz reflectivity is negative or NaN")])
def test_what_cannot_be_used_is_named(write, arrays, named):
    with pytest.raises(InvalidInput, match=named):
        read_scene(write(**arrays))
