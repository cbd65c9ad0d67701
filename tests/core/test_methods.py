"""What every method must do: find known scenes, obey the calibration, survive unusual frames, name wrong options."""

import numpy as np
import pytest

from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.metrics import evaluate
from srt3d_ros.core.sensor.model import GateWords, SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import InvalidInput
from tests.core.scenes import (
    IRF,
    T,
    assert_finite,
    background_alone,
    errors,
    make_sensor,
    ramp,
    run,
    simulate,
    with_photons,
)
from tests.photon_forms import as_gates

every_method = pytest.mark.parametrize("name", METHODS)


@every_method
def test_a_tilted_plane_across_the_end_of_the_period_is_found(name):
    depth = ramp(24, 40, T - 8.5, 0.6, 0.2) % T
    cloud = run(name, simulate(depth, sbr=20, ppp=300), make_sensor(24, 40))
    assert len(cloud) == depth.size and np.abs(errors(cloud, depth)).max() < 3
    assert np.abs(errors(cloud, depth).mean()) < 0.1 and np.abs(errors(cloud, depth)).mean() < 0.5


@every_method
def test_two_layers_are_found_as_a_point_cloud_with_the_stamp_of_the_photons(name):
    depth = np.stack([ramp(12, 20, 150, 0.5, 0), ramp(12, 20, 350, 0, 0.5)])
    frame = simulate(depth, sbr=10, ppp=100)
    sensor = make_sensor(12, 20, toa_offset_bins=300, range_offset_m=0.1)
    cloud = run(name, PhotonEvents(frame.pixel, frame.toa, stamp_ns=1_234_567_890_123_456_789), sensor, surfaces=2)
    types = {"row": "uint16", "col": "uint16", "depth_bins": "float32", "intensity": "float32", "xyz": "float32",
             "depth_std_bins": "float32", "surface": "uint8", "background": "float32"}
    assert {field: str(getattr(cloud, field).dtype) for field in types} == types
    assert cloud.background.shape == (12, 20) and cloud.xyz.shape == (len(cloud), 3)
    keys = list(zip(cloud.row.tolist(), cloud.col.tolist(), cloud.surface.tolist()))
    assert keys == sorted(set(keys)) and (cloud.surface == 1).sum() > 200
    same_pixel = (np.diff(cloud.row) == 0) & (np.diff(cloud.col) == 0)
    assert (np.diff(cloud.intensity)[same_pixel] <= 0).all()
    assert (np.diff(cloud.surface.astype(int))[same_pixel] == 1).all()
    np.testing.assert_allclose(cloud.xyz, sensor.xyz(cloud.row, cloud.col, cloud.depth_bins))
    assert cloud.stamp_ns == 1_234_567_890_123_456_789
    found = evaluate(cloud, depth, 10, T)
    assert found.true_detections > 0.97 and found.false_detections < 0.03 and found.dae_bins < 1.5


@pytest.mark.parametrize("name", ["pooled", "srt3d", "rt3d"])
def test_empty_pixels_are_filled_from_their_neighbours(name):
    depth = ramp(40, 40, 200, 0.4, 0.3)
    frame = simulate(depth, sbr=10, ppp=10)
    empty = np.random.default_rng(1).random(1600) < 0.3
    seen = PhotonEvents(frame.pixel[~empty[frame.pixel]], frame.toa[~empty[frame.pixel]])
    cloud = run(name, seen, make_sensor(40, 40))
    assert len(cloud) > 0.995 * 1600 and np.abs(errors(cloud, depth)).max() < (3 if name == "pooled" else 8)


@pytest.mark.parametrize("name", ["srt3d", "rt3d"])
def test_background_alone_is_taken_for_background(name):
    sensor = make_sensor(48, 48)
    frames = [background_alone(sensor, 5, seed) for seed in range(4)]
    clouds = [run(name, frame, sensor) for frame in frames]
    assert sum(map(len, clouds)) <= 0.1 * len(frames) * sensor.pixels
    background = sum(cloud.background.sum() for cloud in clouds)            # also what the start took for signal
    assert background == pytest.approx(sum(frame.photons for frame in frames), rel=0.03)


@pytest.mark.parametrize("name", ["smle", "xcorr"])
def test_pixelwise_methods_show_a_point_wherever_there_are_photons(name):
    frame = background_alone(make_sensor(48, 48), 0.3, 0)
    assert len(run(name, frame, make_sensor(48, 48))) == len(np.unique(frame.pixel))


@every_method
def test_intensity_and_background_are_the_expected_photons(name):
    sensor = make_sensor(30, 30)
    reflectivity = np.where(ramp(30, 30, 0, 1, 0) < 15, 0.5, 1.5)
    simulator = Simulator(StaticScene(sensor.range_m(np.full((30, 30), 250.0)), reflectivity), sensor, sbr=3, ppp=400)
    _, signal, background = simulator.expected(0)
    cloud = run(name, simulator.frame(0)[0], sensor)
    assert np.abs(cloud.image("intensity") / signal[0] - 1).mean() < 0.12
    assert cloud.intensity.mean() == pytest.approx(signal[0].mean(), rel=0.03)
    assert cloud.background.mean() == pytest.approx(background.mean(), rel=0.05)


# ---- Calibration

@every_method
def test_gain_and_delay_of_the_pixels_leave_no_trace(name):
    rng = np.random.default_rng(5)
    depth = ramp(24, 40, 200, 0.3, 0.2)
    plain = make_sensor(24, 40)
    skewed = plain.replace(gain=rng.uniform(0.3, 1.7, (24, 40)), delay_bins=rng.uniform(-40, 40, (24, 40)))
    one, other = (run(name, simulate(depth, 10, 200, sensor), sensor) for sensor in (plain, skewed))
    assert len(other) == len(one) == depth.size
    assert np.abs(errors(other, depth)).mean() < 1.3 * np.abs(errors(one, depth)).mean() + 0.05
    assert other.intensity.mean() == pytest.approx(one.intensity.mean(), rel=0.03)
    assert (other.background / skewed.gain).mean() == pytest.approx(one.background.mean(), rel=0.15)


@every_method
def test_masked_pixels_show_no_point_whatever_they_saw(name):
    mask = np.random.default_rng(3).random((24, 40)) > 0.1
    depth = ramp(24, 40, 200, 0.3, 0.2)
    hot = np.repeat(np.flatnonzero(~mask), 2_000)
    frame = with_photons(simulate(depth, sbr=10, ppp=50), hot, 500)
    cloud = run(name, frame, make_sensor(24, 40, mask=mask))
    assert mask[cloud.row, cloud.col].all() and len(cloud) == mask.sum()
    assert np.abs(errors(cloud, depth)).max() < 6


@every_method
def test_each_pixels_own_irf_is_used(name):
    shapes = np.stack([np.roll(IRF, shift) for shift in range(-6, 6)] * 10)       # of a pixel, up to 6 bins off
    sensor = make_sensor(10, 12, irf=np.roll(shapes, 7, axis=1), irf_ref=22)
    depth = ramp(10, 12, 200, 0.3, 0.1)
    cloud = run(name, simulate(depth, 10, 300, sensor), sensor)
    assert len(cloud) == 120 and np.abs(errors(cloud, depth)).max() < 2


# ---- Unusual frames

def test_order_and_form_of_the_photons_do_not_matter():
    sensor = make_sensor(9, 11, gates=GateWords(first_word=5, no_detection=0))
    frame = simulate(ramp(9, 11, 200, 0.5, 0), sbr=5, ppp=40)
    order = np.random.default_rng(0).permutation(frame.photons)
    expected = run("rt3d", frame, sensor)
    for form in (PhotonEvents(frame.pixel[order], frame.toa[order]), as_gates(frame, sensor),
                 PhotonEvents(frame.pixel, frame.toa.astype(np.float32))):
        np.testing.assert_allclose(run("rt3d", form, sensor).depth_bins, expected.depth_bins, atol=0.01)


@every_method
@pytest.mark.parametrize(("rows", "cols"), [(1, 1), (1, 50), (50, 1), (33, 33)])
def test_arrays_of_any_shape_work(name, rows, cols):
    depth = np.full((rows, cols), 300.0)
    for surfaces in (1, 3):
        cloud = run(name, simulate(depth, sbr=10, ppp=80), make_sensor(rows, cols), surfaces=surfaces)
        assert_finite(cloud)
        assert (cloud.surface == 0).sum() == rows * cols and np.abs(errors(cloud, depth)[cloud.surface == 0]).max() < 5


@every_method
@pytest.mark.parametrize("photons", [0, 1, 2])
def test_hardly_any_photons_are_survived(name, photons):
    for rows, cols, surfaces in ((1, 1, 1), (1, 40, 2), (9, 33, 1), (9, 33, 2)):
        frame = PhotonEvents(np.zeros(photons, np.uint32), np.full(photons, 77, np.uint16))
        cloud = run(name, frame, make_sensor(rows, cols), surfaces=surfaces)
        assert_finite(cloud)
        most = 0 if name == "pooled" else (photons > 0) * surfaces
        assert len(cloud) <= most and cloud.background.shape == (rows, cols) and cloud.xyz.shape == (len(cloud), 3)
        assert name != "pooled" or (cloud.background[0, 0] > 0) == (photons > 0)


@every_method
def test_a_sensor_without_any_usable_pixel_sees_nothing(name):
    sensor = make_sensor(6, 10, mask=np.zeros((6, 10), bool))
    assert len(run(name, simulate(np.full((6, 10), 200.0), 10, 50), sensor)) == 0


@every_method
@pytest.mark.parametrize(("irf", "num_bins", "m"), [([1.0], T, 1), ([1.0], 3, 1), (np.ones(59), 60, 5),
                                                    (np.ones(30), 20_000, 10), (np.ones(300), 1_000, 40)])
def test_extreme_sensors_give_finite_values(name, irf, num_bins, m):
    sensor = SensorModel(9, 12, num_bins, 1e-10, irf)
    rng = np.random.default_rng(0)
    pixel = np.arange(108, dtype=np.uint32).repeat(30)
    toa = ((num_bins // 2 + rng.integers(0, 2, len(pixel))) % num_bins).astype(np.uint16)
    assert_finite(run(name, PhotonEvents(pixel, toa), sensor, m, surfaces=2), num_bins)


# ---- Options


@every_method
def test_values_that_cannot_be_used_are_named(name):
    for option, value in (("surfaces", 0), ("surfaces", 5), ("surfaces", 1.5), ("surfaces", "2"), ("device", "gpu"),
                          ("device", "cuda"), *[("false_alarm_rate", 0.41)] * (name == "pooled")):
        with pytest.raises(InvalidInput, match=f'^{option} is "?{value}'):
            METHODS[name].build(make_sensor(4, 5), (1, 2, 3), **{option: value})
