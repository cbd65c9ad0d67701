"""The simulated photons have the statistics the model promises."""

import numpy as np
import pytest

from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets.scene import NetScene, StaticScene, net_sensor
from srt3d_ros.datasets.simulator import Simulator
from srt3d_ros.errors import InvalidInput

T = 200
IRF = np.array([0.05, 0.4, 0.3, 0.15, 0.06, 0.04], np.float32)
SIGMAS = 5                  # fixed seeds: a right simulator passes always, a wrong one fails by far more


def make_sensor(rows=20, cols=30, **changes) -> SensorModel:
    return SensorModel(**({"rows": rows, "cols": cols, "num_bins": T, "bin_width_s": 1e-10, "irf": IRF} | changes))


def flat_scene(sensor: SensorModel, depth_bins: float, reflectivity=1.0) -> StaticScene:
    return StaticScene(np.full((sensor.rows, sensor.cols), sensor.range_m(depth_bins)), reflectivity)


def histogram(events, num_bins=T) -> np.ndarray:
    return np.bincount(events.toa, minlength=num_bins)


def shifted_irf(depth_bins: float, irf=IRF, ref=1, num_bins=T) -> np.ndarray:
    """h(x − t) by linear interpolation, wrapped."""
    whole, part = int(np.floor(depth_bins)), depth_bins - np.floor(depth_bins)
    placed = np.zeros(num_bins)
    for shift, weight in ((whole, 1 - part), (whole + 1, part)):
        placed += weight * np.roll(np.pad(irf, (0, num_bins - len(irf))), shift - ref)
    return placed


def chi_square_sigmas(counts: np.ndarray, expected: np.ndarray) -> float:
    """How many standard deviations the chi-square statistic of the counts lies above its mean."""
    sure = expected >= 5
    counts, expected = np.append(counts[sure], counts[~sure].sum()), np.append(expected[sure], expected[~sure].sum())
    counts, expected = counts[expected > 0], expected[expected > 0]
    chi2 = ((counts - expected) ** 2 / expected).sum()
    return (chi2 - len(counts)) / np.sqrt(2 * len(counts))


@pytest.mark.parametrize("ppp", [0.3, 40.0])
def test_counts_of_pixels_are_poisson_with_mean_ppp(ppp):
    sensor = make_sensor(rows=100, cols=100)
    events, _ = Simulator(flat_scene(sensor, 80), sensor, sbr=2, ppp=ppp, seed=1).frame(0)
    counts = np.bincount(events.pixel, minlength=sensor.pixels)
    assert abs(counts.mean() - ppp) < SIGMAS * np.sqrt(ppp / sensor.pixels)
    assert counts.var() == pytest.approx(ppp, rel=SIGMAS * np.sqrt((2 + 1 / ppp) / sensor.pixels))


@pytest.mark.parametrize("sbr", [0.1, 20.0])
def test_signal_to_background_ratio_is_sbr(sbr):
    sensor = make_sensor(rows=60, cols=60)
    simulator = Simulator(flat_scene(sensor, 80), sensor, sbr=sbr, ppp=50, seed=3)
    counts = histogram(simulator.frame(0)[0])
    far = np.ones(T, bool)
    far[70:95] = False
    background = 50 * sensor.pixels / (1 + sbr)
    assert abs(counts[far].sum() - background * far.mean()) < SIGMAS * np.sqrt(background)


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
    assert chi_square_sigmas(histogram(events), 1000 * 600 * shifted_irf(depth_bins)) < SIGMAS


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


def test_gain_delay_and_mask_of_the_sensor_are_obeyed():
    gain = np.where(np.arange(30) < 15, 0.5, 2.0) * np.ones((20, 1))
    delay = np.where(np.arange(20) < 10, 0.0, 25.0)[:, None] * np.ones(30)
    mask = np.ones((20, 30), bool)
    mask[:, 7] = False
    sensor = make_sensor(gain=gain, delay_bins=delay, mask=mask)
    events, truth = Simulator(flat_scene(sensor, 80), sensor, sbr=100, ppp=200, seed=8).frame(0)
    row, col = np.divmod(events.pixel, 30)
    assert not (col == 7).any()
    assert events.photons == pytest.approx(200 * mask.sum(), rel=0.02)
    per_pixel = np.bincount(events.pixel, minlength=600).reshape(20, 30)
    assert per_pixel[:, 15:].mean() / per_pixel[:, :7].mean() == pytest.approx(4, rel=0.03)
    assert np.median(events.toa[row >= 10]) - np.median(events.toa[row < 10]) == 25
    np.testing.assert_allclose(truth, 80, atol=1e-3)


def test_an_irf_per_pixel_is_obeyed():
    irf = np.stack([np.roll(np.pad(IRF, (0, 10)), p % 10) for p in range(600)])
    sensor = make_sensor(irf=irf, irf_ref=1)
    events, _ = Simulator(flat_scene(sensor, 80.5), sensor, sbr=np.inf, ppp=300, seed=9).frame(0)
    kind = events.pixel % 10
    for roll in (0, 4, 9):
        counts = histogram(type(events)(events.pixel[kind == roll], events.toa[kind == roll]))
        assert chi_square_sigmas(counts, 300 * 60 * shifted_irf(80.5 + roll)) < SIGMAS


def test_a_frame_depends_on_seed_and_index_alone():
    scene, sensor = NetScene(net_sensor()), net_sensor()
    forward, backward = (Simulator(scene, sensor, ppp=5, seed=3) for _ in range(2))
    first = {k: forward.frame(k) for k in (0, 1, 2)}
    second = {k: backward.frame(k) for k in (2, 0, 1, 2)}
    for k in first:
        np.testing.assert_array_equal(first[k][0].pixel, second[k][0].pixel)
        np.testing.assert_array_equal(first[k][0].toa, second[k][0].toa)
        np.testing.assert_array_equal(first[k][1], second[k][1])
    assert not np.array_equal(first[0][0].toa, first[1][0].toa)
    other = Simulator(scene, sensor, ppp=5, seed=4).frame(0)[0]
    assert not np.array_equal(first[0][0].toa, other.toa)


def test_the_default_frame_is_sorted_and_fits_its_sensor():
    simulator = Simulator(ppp=3)
    events, truth = simulator.frame(7)
    events.check(simulator.sensor)
    assert (simulator.sensor.rows, simulator.sensor.cols, simulator.sensor.num_bins) == (141, 141, 4613)
    assert events.is_sorted and events.toa.dtype == np.uint16 and events.pixel.dtype == np.uint32
    assert events.stamp_ns == 700_000_000
    assert np.isfinite(truth).all() and truth.shape == (1, 141, 141)


@pytest.mark.parametrize(("field", "changes"), [
    ("sbr", {"sbr": float("nan")}), ("ppp", {"ppp": -1}), ("ppp", {"ppp": 1e9}), ("seed", {"seed": 0.5}),
    ("frame_rate_hz", {"frame_rate_hz": 0}), ("scene", {"scene": StaticScene(np.full((20, 30), 5.0), 0)}),
    ("scene shape", {"scene": StaticScene(np.full((20, 31), 5.0))}),
    ("reflectivity", {"scene": StaticScene(np.full((20, 30), 5.0), -1)})])
def test_bad_arguments_are_named(field, changes):
    sensor = make_sensor()
    with pytest.raises(InvalidInput) as caught:
        Simulator(**({"scene": flat_scene(sensor, 80), "sensor": sensor} | changes))
    assert caught.value.field == field


def test_depths_count_from_the_sensors_offsets():
    sensor = make_sensor(toa_offset_bins=7.0, range_offset_m=0.25)
    depth, _, _ = Simulator(flat_scene(sensor, 50.5), sensor).expected(0)
    np.testing.assert_allclose(depth, 50.5, atol=1e-3)
