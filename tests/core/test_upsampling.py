"""Clouds on finer pixels than the sensor has: where their points lie, and that nothing is gained or lost."""

import numpy as np
import pytest

from srt3d_ros.core.cloud import PointCloud, refine
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import InvalidInput
from tests.core import scenes
from tests.core.scenes import pooled

T = 300
IRF = np.exp(-0.5 * ((np.arange(31) - 12) / 4)**2)


def make_sensor(rows=16, cols=20, **changes) -> SensorModel:
    return SensorModel(rows, cols, T, 100e-12, IRF, **changes)


def simulate(sensor: SensorModel, depth_bins: np.ndarray, ppp=60.0) -> PhotonEvents:
    return scenes.simulate(depth_bins, 5.0, ppp, sensor, seed=3)


def plane(start: float, per_col: float, per_row: float, factor=1) -> np.ndarray:
    """Depth at the centres of pixels that are `factor` times finer."""
    y, x = ((np.arange(size * factor) + 0.5) / factor - 0.5 for size in (16, 20))
    return start + per_col * x + per_row * y[:, None]


@pytest.mark.parametrize("factor", [2, 4])
def test_a_tilted_plane_has_depths_between_those_of_the_pixels(factor):
    sensor = make_sensor()
    cloud = pooled(simulate(sensor, plane(100, 2.5, -2)), sensor, upsampling=factor)
    finer, truth = sensor.upsampled(factor), plane(100, 2.5, -2, factor)
    np.testing.assert_allclose(cloud.xyz, finer.xyz(cloud.row, cloud.col, cloud.depth_bins), rtol=1e-6)
    assert (np.diff(cloud.row.astype(int) * finer.cols + cloud.col) > 0).all()      # sorted, one surface in each
    inside = (slice(2 * factor, -2 * factor),) * 2
    error = (cloud.image("depth_bins") - truth)[inside]
    assert np.isfinite(error).all()
    # All depths of a pixel alike would be up to half a pixel's rise, 2.25 bins, off.
    assert np.abs(error).mean() < 0.3 and np.abs(error).max() < 1.2


def test_photons_are_shared_out_and_standard_deviations_stay():
    sensor = make_sensor()
    frame = simulate(sensor, plane(150, 1, 0.5))
    whole, split = (pooled(frame, sensor, upsampling=factor) for factor in (1, 3))
    assert split.intensity.sum() == pytest.approx(whole.intensity.sum(), rel=1e-5)
    assert split.background.sum() == pytest.approx(whole.background.sum(), rel=1e-5)
    assert split.intensity.sum() + split.background.sum() == pytest.approx(frame.photons, rel=0.02)
    np.testing.assert_array_equal(split.image("depth_std_bins")[1::3, 1::3], whole.image("depth_std_bins"))
    np.testing.assert_allclose(split.image("depth_bins")[1::3, 1::3], whole.image("depth_bins"), atol=1e-4)


def test_depths_that_cross_the_end_of_the_period_wrap():
    finer = make_sensor(2, 2).upsampled(2)
    near_end = PointCloud(np.array([0], np.uint16), np.array([1], np.uint16), np.float32([T - 0.5]), np.float32([8]),
                          np.float32([1]), np.zeros((1, 3), np.float32), np.uint8([0]), np.zeros((2, 2), np.float32), 7)
    cloud = refine(near_end, 2, finer, np.float32([4]), np.float32([0]))
    assert list(zip(cloud.row, cloud.col)) == [(0, 2), (0, 3), (1, 2), (1, 3)] and cloud.stamp_ns == 7
    np.testing.assert_allclose(cloud.depth_bins, [T - 1.5, T - 1.5, 0.5, 0.5])
    np.testing.assert_allclose(cloud.intensity, 2)
    assert [a.dtype for a in (cloud.row, cloud.depth_bins, cloud.intensity, cloud.xyz, cloud.surface)] == [
        np.uint16, np.float32, np.float32, np.float32, np.uint8]


@pytest.mark.parametrize("factor", [0, 5, 1.5, "2", True])
def test_factors_that_cannot_be_used_are_named(factor):
    with pytest.raises(InvalidInput, match=f"^upsampling is {factor}: expected an integer from 1 to 4"):
        Pooled(make_sensor(), (1, 2, 3), upsampling=factor)


def test_calibration_is_that_of_the_pixel():
    rng = np.random.default_rng(0)
    sensor = make_sensor(delay_bins=rng.uniform(-9, 9, (16, 20)), gain=rng.uniform(0.5, 2, (16, 20)),
                         mask=rng.random((16, 20)) > 0.1)
    depth = plane(120, 0, 1)
    cloud = pooled(simulate(sensor, depth, ppp=200), sensor, upsampling=2)
    seen = np.isfinite(cloud.image("depth_bins"))
    assert np.array_equal(seen, sensor.mask.repeat(2, axis=0).repeat(2, axis=1))
    error = circular_difference(cloud.depth_bins.astype(float), plane(120, 0, 1, 2)[cloud.row, cloud.col], T)
    assert np.abs(error).max() < 1
