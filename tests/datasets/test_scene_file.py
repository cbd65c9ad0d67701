"""Scene files: what is seen of them, by which sensor, and what cannot be used."""

import numpy as np
import pytest

from srt3d_ros.datasets.scene import read_scene
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.errors import InvalidInput


@pytest.fixture
def write(tmp_path):
    """Write a scene file; returns its path."""
    def call(**arrays):
        np.savez(tmp_path / "scene.npz", **arrays)
        return tmp_path / "scene.npz"
    return call


DEPTH_M = 4 + 0.3 * np.arange(48).reshape(6, 8) / 48


def test_the_sensor_sees_the_depths_of_the_file_in_the_middle_of_its_bins(write):
    valid = np.ones((6, 8), bool)
    valid[2, 3] = False
    scene, sensor = read_scene(write(depth_m=DEPTH_M, reflectivity=np.full((6, 8), 0.5), valid=valid))
    depth, signal, _ = Simulator(scene, sensor, ppp=10).expected(0)
    assert (sensor.rows, sensor.cols, sensor.num_bins) == (6, 8, 4613)
    assert sensor.bin_width_m == pytest.approx(0.3e-3)
    np.testing.assert_allclose(sensor.range_m(depth[0][valid]), DEPTH_M[valid], atol=1e-5)
    assert np.isnan(depth[0, 2, 3]) and signal[0, 2, 3] == 0
    assert np.nanmin(depth) + np.nanmax(depth) == pytest.approx(4613, abs=2)


def test_large_scenes_are_thinned_to_pixels_of_their_own(write):
    depth_m = 2 + np.random.default_rng(0).random((400, 600))
    scene, sensor = read_scene(write(depth_m=depth_m))
    range_m, reflectivity = scene.frame(0)
    assert (sensor.rows, sensor.cols) == range_m.shape[1:] == (94, 141)
    assert np.isin(range_m, depth_m.astype(np.float32)).all() and (reflectivity == 1).all()
    assert read_scene(write(depth_m=depth_m), size=30)[1].cols == 30


def test_unknown_depths_are_no_surface(write):
    depth_m = DEPTH_M.copy()
    depth_m[0, 0], depth_m[0, 1] = 0, np.nan
    range_m, reflectivity = read_scene(write(depth_m=depth_m))[0].frame(0)
    assert np.isnan(range_m[0, 0, :2]).all() and (reflectivity[0, 0, :2] == 0).all()
    assert np.isfinite(range_m[0, 1:]).all()


@pytest.mark.parametrize(("arrays", "named"), [
    ({"other": DEPTH_M}, "scene.npz depth_m is missing"), ({"depth_m": DEPTH_M[0]}, "scene.npz depth_m"),
    ({"depth_m": np.full((6, 8), "near")}, "scene.npz depth_m"), ({"depth_m": np.zeros((6, 8))}, "unknown everywhere"),
    ({"depth_m": np.full((6, 8), np.nan)}, "unknown everywhere"),
    ({"depth_m": DEPTH_M * np.linspace(1, 2, 8)}, "a span below 1.38 m"),
    ({"depth_m": DEPTH_M, "valid": np.zeros((6, 8), bool)}, "unknown everywhere"),
    ({"depth_m": DEPTH_M, "valid": np.ones((8, 6), bool)}, "scene.npz valid"),
    ({"depth_m": DEPTH_M, "reflectivity": np.ones(8)}, "scene.npz reflectivity"),
    ({"depth_m": DEPTH_M, "reflectivity": np.full((6, 8), -1.0)}, "scene.npz reflectivity is negative"),
    ({"depth_m": DEPTH_M, "reflectivity": np.full((6, 8), np.nan)}, "scene.npz reflectivity is negative or NaN")])
def test_what_cannot_be_used_is_named(write, arrays, named):
    with pytest.raises(InvalidInput, match=named):
        read_scene(write(**arrays))


def test_a_file_that_is_none_is_named(tmp_path):
    (tmp_path / "notes.npz").write_text("no scene")
    for name in ("absent.npz", "notes.npz"):
        with pytest.raises(InvalidInput, match=name):
            read_scene(tmp_path / name)
