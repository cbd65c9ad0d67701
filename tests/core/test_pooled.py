"""Reconstructions of scenes whose answer is known, and the goals of the project on measured photons."""

import numpy as np
import pytest

from srt3d_ros.core.frequencies import angular_frequencies, choose, irf_spectrum
from srt3d_ros.core.metrics import circular_difference, evaluate
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.datasets.scene import StaticScene
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.errors import InvalidInput

T = 586
IRF = np.exp(-0.5 * ((np.arange(40) - 15) / np.where(np.arange(40) < 15, 3, 5))**2)     # steep rise, slow decay


def make_sensor(rows: int, cols: int, **changes) -> SensorModel:
    return SensorModel(rows, cols, T, 16e-12, IRF, **changes)


def reconstruct(frame, sensor: SensorModel, sketch_size=None, **options):
    frequencies = choose("auto", sensor, sketch_size)
    sketch = frame if isinstance(frame, Sketch) else sketch_photons(frame, sensor, frequencies)
    return Pooled(sensor, frequencies, **options)(sketch)


def simulate(depth_bins: np.ndarray, sbr: float, ppp: float, sensor=None, seed=0) -> tuple[PhotonEvents, np.ndarray]:
    """Photons of surfaces at these depths, [rows, cols] or [S, rows, cols], and the depths."""
    sensor = sensor or make_sensor(*depth_bins.shape[-2:])
    return Simulator(StaticScene(sensor.range_m(depth_bins)), sensor, sbr=sbr, ppp=ppp, seed=seed).frame(0)


def exact(sensor: SensorModel, depth_bins: np.ndarray, signal=20.0, background=0.0, m=None) -> Sketch:
    """The expected sketch: that of photons without their noise."""
    frequencies = choose("auto", sensor, m)
    omega = angular_frequencies(frequencies, T)
    sums = signal * irf_spectrum(sensor, frequencies) * np.exp(1j * omega * depth_bins[..., None])
    return Sketch(frequencies, sums.astype(np.complex64), np.full(depth_bins.shape, signal + background, np.uint32))


def background_alone(sensor: SensorModel, ppp: float, seed: int) -> PhotonEvents:
    rng = np.random.default_rng(seed)
    count = rng.poisson(ppp * sensor.pixels)
    return PhotonEvents(np.sort(rng.integers(0, sensor.pixels, count)).astype(np.uint32),
                        rng.integers(0, T, count).astype(np.uint16))


def errors(cloud, depth_bins) -> np.ndarray:
    """Of each point, from the depth of its pixel, or the nearest of several depths of the scene."""
    depth_bins = np.asarray(depth_bins)
    truth = depth_bins[cloud.row, cloud.col][:, None] if depth_bins.ndim == 2 else depth_bins[None]
    difference = circular_difference(cloud.depth_bins[:, None].astype(np.float64), truth, T)
    return difference[np.arange(len(difference)), np.abs(difference).argmin(axis=1)]


def ramp(rows: int, cols: int, start: float, per_col: float, per_row: float) -> np.ndarray:
    y, x = np.mgrid[:rows, :cols]
    return start + per_col * x + per_row * y


def step(near: float, far: float, rows=48, cols=64) -> np.ndarray:
    return np.where(np.arange(cols) < cols // 2, near, far) + np.zeros((rows, 1))


# ---- Without noise

@pytest.mark.parametrize("per_col", [0, 0.5, 2, 5])
@pytest.mark.parametrize("signal", [20.0, 500.0])
def test_a_tilted_plane_is_found_to_a_tenth_of_a_bin_up_to_its_borders(per_col, signal):
    depth = ramp(24, 40, 200.3, per_col, -0.7 * per_col)
    cloud = reconstruct(exact(make_sensor(24, 40), depth, signal), make_sensor(24, 40))
    assert len(cloud) == depth.size and np.abs(errors(cloud, depth)).max() < 0.1
    np.testing.assert_allclose(cloud.intensity, signal, rtol=0.01)
    assert cloud.background.max() < 0.01 * signal


def test_a_surface_across_the_end_of_the_period_is_one_surface():
    depth = ramp(16, 40, T - 12.5, 0.6, 0.2) % T
    cloud = reconstruct(exact(make_sensor(16, 40), depth), make_sensor(16, 40))
    assert len(cloud) == depth.size and np.abs(errors(cloud, depth)).max() < 0.05


@pytest.mark.parametrize("depth", [0.0, -1e-7, 1e-7, T - 1e-5])
def test_depths_lie_in_the_period(depth):
    cloud = reconstruct(exact(make_sensor(6, 7), np.full((6, 7), depth)), make_sensor(6, 7))
    assert len(cloud) == 42 and (cloud.depth_bins >= 0).all() and (cloud.depth_bins < T).all()


def test_points_are_placed_by_the_sensor():
    sensor = make_sensor(8, 9, toa_offset_bins=5_000, range_offset_m=0.3)
    depth = ramp(8, 9, 200, 1, 2)
    cloud = reconstruct(exact(sensor, depth), sensor)
    np.testing.assert_allclose(cloud.xyz, sensor.xyz(cloud.row, cloud.col, cloud.depth_bins))
    np.testing.assert_allclose(np.linalg.norm(cloud.xyz, axis=1), sensor.range_m(depth).ravel(), rtol=1e-4)


def test_fields_have_the_types_and_order_of_a_point_cloud():
    depth = np.stack([ramp(12, 20, 150, 0.5, 0), ramp(12, 20, 350, 0, 0.5)])
    frame, _ = simulate(depth, sbr=10, ppp=60)
    cloud = reconstruct(frame, make_sensor(12, 20), surfaces=2)
    types = {"row": "uint16", "col": "uint16", "depth_bins": "float32", "intensity": "float32", "xyz": "float32",
             "depth_std_bins": "float32", "surface": "uint8", "background": "float32"}
    assert {name: str(getattr(cloud, name).dtype) for name in types} == types
    assert cloud.background.shape == (12, 20) and cloud.xyz.shape == (len(cloud), 3)
    keys = list(zip(cloud.row.tolist(), cloud.col.tolist(), cloud.surface.tolist()))
    assert keys == sorted(set(keys))
    same_pixel = (np.diff(cloud.row) == 0) & (np.diff(cloud.col) == 0)
    assert same_pixel.any() and (np.diff(cloud.intensity)[same_pixel] <= 0).all()
    assert (np.diff(cloud.surface.astype(int))[same_pixel] == 1).all()


def test_the_stamp_passes_through():
    frame, _ = simulate(np.full((4, 5), 200.0), sbr=10, ppp=20)
    stamped = PhotonEvents(frame.pixel, frame.toa, stamp_ns=1_234_567_890_123_456_789)
    assert reconstruct(stamped, make_sensor(4, 5)).stamp_ns == 1_234_567_890_123_456_789


# ---- With photons

@pytest.mark.parametrize("gap", [20, 60, 200])
@pytest.mark.parametrize(("ppp", "sbr"), [(10, 10), (10, 1), (100, 10)])
def test_at_a_step_edge_no_points_fly(gap, ppp, sbr):
    depth = step(200, 200 + gap)
    cloud = reconstruct(simulate(depth, sbr, ppp)[0], make_sensor(*depth.shape))
    assert (np.abs(errors(cloud, [200, 200 + gap])) > 10).mean() <= 0.001
    assert (np.abs(errors(cloud, depth)) > 10).mean() <= 0.005           # and nearly all are on their own side
    assert len(cloud) >= 0.999 * depth.size


def test_a_bar_of_three_pixels_is_kept():
    y, x = np.mgrid[:48, :64]
    depth = np.where(np.abs(x - 0.7 * y - 15) < 2, 200.0, 400.0)
    cloud = reconstruct(simulate(depth, sbr=10, ppp=10)[0], make_sensor(48, 64))
    assert (np.abs(errors(cloud, [200, 400])) > 10).mean() <= 0.001
    assert (np.abs(errors(cloud, depth)) > 10).mean() <= 0.01


def test_empty_pixels_are_filled_from_their_neighbours():
    depth = ramp(40, 40, 200, 0.4, 0.3)
    frame, _ = simulate(depth, sbr=10, ppp=10)
    empty = np.random.default_rng(1).random(1600) < 0.3
    seen = PhotonEvents(frame.pixel[~empty[frame.pixel]], frame.toa[~empty[frame.pixel]])
    found = evaluate(reconstruct(seen, make_sensor(40, 40)), depth, 3, T)
    assert found.true_detections > 0.99 and found.false_detections < 0.001


def test_few_photons_share_what_they_know():
    depth = ramp(48, 48, 200, 0.3, -0.2)
    found = evaluate(reconstruct(simulate(depth, sbr=1, ppp=2)[0], make_sensor(48, 48)), depth, 10, T)
    assert found.true_detections > 0.98 and found.false_detections < 0.02 and found.dae_bins < 1.2


def test_intensity_and_background_are_the_expected_photons():
    rng = np.random.default_rng(4)
    sensor = make_sensor(40, 40)
    reflectivity = np.where(ramp(40, 40, 0, 1, 0) < 20, 0.5, 1.5) * rng.uniform(0.8, 1.2, (40, 40))
    scene = StaticScene(sensor.range_m(np.full((40, 40), 250.0)), reflectivity)
    simulator = Simulator(scene, sensor, sbr=3, ppp=400)
    _, signal, background = simulator.expected(0)
    cloud = reconstruct(simulator.frame(0)[0], sensor)
    assert np.abs(cloud.image("intensity") / signal[0] - 1).mean() < 0.08
    assert cloud.background.mean() == pytest.approx(background.mean(), rel=0.03)


@pytest.mark.parametrize("ppp", [3, 30])
def test_an_even_surface_looks_even(ppp):
    depth = ramp(40, 40, 200, 0.3, 0.2)
    cloud = reconstruct(simulate(depth, sbr=10, ppp=ppp)[0], make_sensor(40, 40))
    assert cloud.intensity.std() < 0.3 * np.sqrt(cloud.intensity.mean())        # of the counts of single pixels


def test_the_grain_of_a_surface_is_kept_where_photons_show_it():
    reflectivity = np.random.default_rng(6).uniform(0.5, 1.5, (40, 40))
    sensor = make_sensor(40, 40)
    scene = StaticScene(sensor.range_m(np.full((40, 40), 250.0)), reflectivity)
    cloud = reconstruct(Simulator(scene, sensor, sbr=10, ppp=300).frame(0)[0], sensor)
    assert np.corrcoef(cloud.image("intensity").ravel(), reflectivity.ravel())[0, 1] > 0.95


@pytest.mark.parametrize(("ppp", "sbr"), [(10, 1), (50, 0.3), (5, 10)])
def test_a_surface_does_not_grow_over_pixels_that_see_background_alone(ppp, sbr):
    depth = ramp(48, 64, 200, 0.3, 0.2)
    sensor = make_sensor(48, 64)
    beyond = 0
    for seed in range(1, 5):
        frame, dark = simulate(depth, sbr, ppp)[0], background_alone(sensor, max(ppp / (1 + sbr), 3), seed=seed)
        lit, dim = frame.pixel % 64 < 32, dark.pixel % 64 >= 32
        pixel, toa = (np.concatenate([getattr(frame, name)[lit], getattr(dark, name)[dim]])
                      for name in ("pixel", "toa"))
        cloud = reconstruct(PhotonEvents(pixel, toa), sensor)
        assert (cloud.col < 32).sum() > 0.995 * 48 * 32 and (cloud.col == 32).sum() < 48
        beyond += (cloud.col > 33).sum()
    assert beyond <= 4                  # of 4 × 48 × 30 pixels, some of which look like the surface by chance


@pytest.mark.parametrize(("gap", "ppp", "sbr"), [(150, 50, 10), (150, 50, 1), (40, 50, 10), (150, 15, 10)])
def test_two_separate_layers_are_both_found(gap, ppp, sbr):
    depth = np.stack([ramp(24, 40, 150, 0.3, 0), ramp(24, 40, 150 + gap, 0.3, 0)])
    frame, truth = simulate(depth, sbr, ppp)
    found = evaluate(reconstruct(frame, make_sensor(24, 40), surfaces=2), truth, 10, T)
    assert found.true_detections > 0.99 and found.false_detections < 0.01 and found.dae_bins < 0.7


def test_a_single_layer_stays_single():
    depth = ramp(24, 40, 150, 0.3, 0.1)
    for surfaces in (2, 4):
        cloud = reconstruct(simulate(depth, sbr=5, ppp=50)[0], make_sensor(24, 40), surfaces=surfaces)
        assert evaluate(cloud, depth, 10, T).false_detections < 0.005 and (cloud.surface == 0).sum() == depth.size


def test_masked_pixels_show_no_point_whatever_they_saw():
    mask = np.random.default_rng(3).random((24, 40)) > 0.1
    sensor = make_sensor(24, 40, mask=mask)
    depth = ramp(24, 40, 200, 0.3, 0.2)
    frame, _ = simulate(depth, sbr=10, ppp=20)
    hot = np.repeat(np.flatnonzero(~mask), 5_000).astype(np.uint32)      # hot pixels shout a depth of 500
    pixel, toa = np.append(frame.pixel, hot), np.append(frame.toa, np.full(len(hot), 500, np.uint16))
    cloud = reconstruct(PhotonEvents(pixel, toa), sensor)
    assert mask[cloud.row, cloud.col].all() and len(cloud) == mask.sum()
    assert np.abs(errors(cloud, depth)).max() < 4


def test_gain_and_delay_of_the_pixels_leave_no_trace():
    rng = np.random.default_rng(5)
    depth = ramp(24, 40, 200, 0.3, 0.2)
    plain = make_sensor(24, 40)
    skewed = plain.replace(gain=rng.uniform(0.3, 1.7, (24, 40)), delay_bins=rng.uniform(-40, 40, (24, 40)))
    one, other = (reconstruct(simulate(depth, 10, 100, sensor)[0], sensor) for sensor in (plain, skewed))
    assert len(other) == len(one) == depth.size
    assert np.abs(errors(other, depth)).mean() < 1.3 * np.abs(errors(one, depth)).mean()
    assert other.intensity.mean() == pytest.approx(one.intensity.mean(), rel=0.03)
    assert (other.background / skewed.gain).mean() == pytest.approx(one.background.mean(), rel=0.1)


# The formula takes planes and weights, which are measured themselves, for known: seen are 1.05 to 1.4, and 1.5 at a
# slope of 5 bins a pixel.
@pytest.mark.parametrize(("per_col", "sbr", "ppp"), [(0, 10, 100), (0.3, 1, 100), (0.5, 10, 1000), (0.5, 10, 10),
                                                     (2, 10, 100), (2, 1, 30)])
@pytest.mark.parametrize("gain", [1.0, 0.25])
def test_errors_are_as_large_as_their_standard_deviations_say(per_col, sbr, ppp, gain):
    depth = ramp(40, 40, 200.3, per_col, 0.2)
    sensor = make_sensor(40, 40, gain=np.full((40, 40), gain))
    cloud = reconstruct(simulate(depth, sbr, ppp, sensor)[0], sensor)
    ratio = errors(cloud, depth) / cloud.depth_std_bins
    assert 1 / 1.6 < np.sqrt((ratio**2).mean()) < 1.6


# ---- Background alone

@pytest.mark.parametrize("ppp", [0.02, 0.3, 5, 100])
@pytest.mark.parametrize(("m", "rate"), [(5, 1e-3), (10, 1e-3), (40, 1e-3), (10, 1e-2)])
def test_background_alone_shows_few_points(m, rate, ppp):
    sensor, frames = make_sensor(64, 64), 20
    points = [len(reconstruct(background_alone(sensor, ppp, seed), sensor, m, false_alarm_rate=rate))
              for seed in range(frames)]
    # A false point comes with its window's 120 pixels or more, so that counts scatter: 11 times the rate, or 4 of them.
    assert sum(points) <= max(11 * rate * frames * sensor.pixels, 4 * 120)


def test_fewer_false_alarms_are_allowed_fewer_points_appear():
    sensor = make_sensor(64, 64)
    frame = background_alone(sensor, 20, seed=1)
    points = [len(reconstruct(frame, sensor, false_alarm_rate=rate)) for rate in (0.3, 0.03, 1e-4, 1e-17, 1e-320)]
    assert points == sorted(points, reverse=True) and points[0] > 100 and points[-1] == 0


# ---- Unusual frames

@pytest.mark.parametrize(("rows", "cols"), [(1, 1), (1, 50), (50, 1), (2, 3), (1, 32), (33, 33)])
@pytest.mark.parametrize("surfaces", [1, 3])
def test_arrays_of_any_shape_work(rows, cols, surfaces):
    depth = np.full((rows, cols), 300.0)
    cloud = reconstruct(simulate(depth, sbr=10, ppp=50)[0], make_sensor(rows, cols), surfaces=surfaces)
    assert_finite(cloud)
    assert (cloud.surface == 0).sum() == rows * cols and np.abs(errors(cloud, depth)[cloud.surface == 0]).max() < 5


def assert_finite(cloud):
    for name in ("depth_bins", "intensity", "depth_std_bins", "xyz", "background"):
        assert np.isfinite(getattr(cloud, name)).all(), name
    assert (cloud.intensity > 0).all() and (cloud.depth_std_bins > 0).all() and (cloud.background >= 0).all()


@pytest.mark.parametrize("photons", [0, 1, 2])
@pytest.mark.parametrize(("rows", "cols"), [(1, 1), (1, 40), (9, 33)])
@pytest.mark.parametrize("surfaces", [1, 2])
def test_hardly_any_photons_show_nothing(photons, rows, cols, surfaces):
    frame = PhotonEvents(np.zeros(photons, np.uint32), np.full(photons, 77, np.uint16))
    cloud = reconstruct(frame, make_sensor(rows, cols), surfaces=surfaces)
    assert len(cloud) == 0 and cloud.xyz.shape == (0, 3)
    assert cloud.background.shape == (rows, cols) and cloud.background[0, 0] == photons


def test_photons_that_all_fall_on_one_bin_are_one_surface():
    frame = PhotonEvents(np.arange(60, dtype=np.uint32).repeat(200), np.full(12_000, 123, np.uint16))
    cloud = reconstruct(frame, make_sensor(6, 10))
    assert_finite(cloud)
    assert len(cloud) == 60 and np.ptp(cloud.depth_bins) < 0.01


def test_a_sensor_without_any_usable_pixel_sees_nothing():
    sensor = make_sensor(6, 10, mask=np.zeros((6, 10), bool))
    assert len(reconstruct(simulate(np.full((6, 10), 200.0), 10, 50)[0], sensor)) == 0


@pytest.mark.parametrize(("irf", "num_bins", "m"), [([1.0], T, None), ([1.0], T, 1), ([1.0], 8, None), ([1.0], 3, None),
                                                    (np.ones(59), 60, 5), (np.ones(30), 65_535, None),
                                                    (np.ones(300), 1_000, 40)])
def test_extreme_sensors_give_finite_values(irf, num_bins, m):
    sensor = SensorModel(9, 12, num_bins, 1e-10, irf)
    rng = np.random.default_rng(0)
    pixel = np.arange(108, dtype=np.uint32).repeat(30)
    toa = ((num_bins // 2 + rng.integers(0, 2, len(pixel))) % num_bins).astype(np.uint16)
    assert_finite(reconstruct(PhotonEvents(pixel, toa), sensor, m, surfaces=2))


def test_each_pixels_own_irf_is_used():
    shapes = np.stack([np.roll(IRF, shift) for shift in range(-6, 6)] * 10)       # of a pixel, up to 6 bins off
    sensor = SensorModel(10, 12, T, 16e-12, np.roll(shapes, 7, axis=1), irf_ref=22)
    depth = ramp(10, 12, 200, 0.3, 0.1)
    cloud = reconstruct(simulate(depth, 10, 100, sensor)[0], sensor)
    assert len(cloud) == 120 and np.abs(errors(cloud, depth)).max() < 2


def test_warming_up_changes_nothing():
    frame, _ = simulate(ramp(12, 20, 200, 0.5, 0), sbr=10, ppp=20)
    sensor = make_sensor(12, 20)
    frequencies = choose("auto", sensor)
    sketch = sketch_photons(frame, sensor, frequencies)
    pooled = Pooled(sensor, frequencies)
    before = pooled(sketch)
    pooled.warm_up()
    assert np.array_equal(pooled(sketch).depth_bins, before.depth_bins)


# ---- What it refuses

@pytest.mark.parametrize(("options", "named"), [
    ({"surfaces": 0}, "surfaces is 0"), ({"surfaces": 5}, "surfaces is 5"), ({"surfaces": 1.5}, "surfaces is 1.5"),
    ({"surfaces": "2"}, "surfaces is 2: expected an integer"), ({"false_alarm_rate": 0}, "false_alarm_rate is 0"),
    ({"false_alarm_rate": 1}, "false_alarm_rate is 1"), ({"false_alarm_rate": -0.1}, "false_alarm_rate is -0.1"),
    ({"false_alarm_rate": float("nan")}, "false_alarm_rate is nan"), ({"device": "gpu"}, "device is gpu"),
    ({"device": ""}, "device is empty"), ({"frequencies": (1, 300)}, "frequencies is 300"),
    ({"frequencies": ()}, "sketch size is 0")])
def test_parameters_that_cannot_be_used_are_named(options, named):
    with pytest.raises(InvalidInput, match=f"^{named}"):
        Pooled(make_sensor(4, 5), **({"frequencies": (1, 2, 3)} | options))


def test_a_sketch_of_other_frequencies_is_refused():
    sensor = make_sensor(4, 5)
    with pytest.raises(InvalidInput, match=r"^sketch frequencies is \[1, 2\]: expected \[1, 2, 3\]"):
        Pooled(sensor, (1, 2, 3))(Sketch((1, 2), np.zeros((4, 5, 2), np.complex64), np.zeros((4, 5), np.uint32)))


@pytest.mark.parametrize(("irf", "frequencies"), [(np.ones(T), (1, 2, 3)), (IRF, (150, 200, 290))])
def test_frequencies_that_the_irf_does_not_pass_are_refused(irf, frequencies):
    with pytest.raises(InvalidInput, match=r"^frequencies is \[.*\]: expected some that the sensor's IRF passes"):
        Pooled(make_sensor(4, 5).replace(irf=irf, irf_ref=None), frequencies)


def test_a_sketch_of_another_size_is_refused():
    sensor = make_sensor(4, 5)
    with pytest.raises(InvalidInput, match=r"^sketch size is \(5, 4\): expected rows × cols = \(4, 5\)"):
        Pooled(sensor, (1, 2))(Sketch((1, 2), np.zeros((5, 4, 2), np.complex64), np.zeros((5, 4), np.uint32)))
