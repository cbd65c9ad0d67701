"""Backgrounds that are not even: taken out exactly in expectation, found where nobody knows them, and only there."""

import numpy as np
import pytest

from srt3d_ros.core.method.background import Background
from srt3d_ros.core.method.matched_frame import Matcher
from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.metrics import circular_difference, evaluate
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.core.sketching.sums import PhaseSums
from tests.core import scenes
from tests.core.scenes import IRF, background_alone, with_photons

T = 600
BINS = np.arange(T)
SHAPES = {"ramp": 0.1 + BINS / T, "fog": np.exp(-BINS / 60) + 0.02, "lump": 0.1 + 5 * BINS / 60 * np.exp(-BINS / 60)}
Y, X = np.mgrid[:48, :48]
DEPTH = np.where(np.hypot(X - 24, Y - 24) < 16, 330 - 0.08 * ((X - 24)**2 + (Y - 24)**2), 450.0)     # a ball, a wall
SLOPE, WALL = 150 + 0.7 * X, np.full((48, 48), 250.0)
LAYERS = np.stack([WALL - 150, WALL + 50])


def make_sensor(rows=48, cols=48, **changes) -> SensorModel:
    return scenes.make_sensor(rows, cols, num_bins=T, **changes)


def simulate(sensor: SensorModel, depth_bins=DEPTH, sbr=0.3, ppp=20.0) -> PhotonEvents:
    return scenes.simulate(depth_bins, sbr, ppp, sensor)


def reconstruct(frame: PhotonEvents, sensor: SensorModel, background="sensor", **options):
    return scenes.pooled(frame, sensor, background=background, **options)


def sketches(sensor: SensorModel, depth_bins=DEPTH, sbr=0.1, ppp=20.0, frames=6) -> list[PhaseSums]:
    """A stream of a scene that does not move."""
    frequencies = choose_frequencies("auto", sensor)
    return [sketch_photons(scenes.simulate(depth_bins, sbr, ppp, sensor, seed), sensor, frequencies)
            for seed in range(frames)]


def judged(cloud, depth_bins=DEPTH):
    return evaluate(cloud, depth_bins, 10, T)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("changes", [{}, {"delay_bins": X[:8, :12] * 3.0}, {"irf": np.stack([np.roll(
    np.pad(IRF, 10), shift % 9) for shift in range(96)]), "irf_ref": 25}], ids=["plain", "delay", "IRF per pixel"])
def test_nothing_is_left_of_the_expected_background(shape, changes):
    sensor = make_sensor(8, 12, background_shape=SHAPES[shape], **changes)
    frequencies = choose_frequencies("auto", sensor)
    omega = 2 * np.pi * np.array(frequencies) / T
    one = np.exp(1j * np.outer(omega, BINS)) @ sensor.background_shape.astype(np.float64)
    sums = (50 * one * np.exp(1j * omega * sensor.late[..., None])).astype(np.complex64)
    sketch = PhaseSums(frequencies, sums, np.full((8, 12), 50, np.uint32), sensor=sensor)
    matcher = Matcher(sensor, frequencies)
    background = Background(matcher, "sensor")
    photons, mean, clutter = background.removed(background.first, sketch)
    before = matcher.equaliser * sums
    left = before - photons[..., None] * matcher.passed * mean
    assert np.abs(before).max() > 5 and np.abs(left).max() < 1e-3 and clutter.min() == 1 < clutter.max()


# Not the wall in fog: there is nothing to tell the fog's sharp edge from a second wall.
@pytest.mark.parametrize(("shape", "depth_bins", "options", "changes"), [
    ("fog", DEPTH, {}, {}), ("fog", SLOPE, {}, {}), ("ramp", SLOPE, {}, {}), ("lump", WALL, {}, {}),
    ("fog", DEPTH, {"surfaces": 2}, {}),
    ("fog", DEPTH, {}, {"delay_bins": X * 3.0, "gain": 0.5 + X / 48, "mask": (X + Y) % 17 > 0})])
def test_a_background_that_nobody_knows_is_found(shape, depth_bins, options, changes):
    frame, sensor = simulate(make_sensor(background_shape=SHAPES[shape], **changes), depth_bins), make_sensor(**changes)
    seen = np.where(sensor.used, depth_bins, np.nan)
    found, flat = (judged(reconstruct(frame, sensor, how, **options), seen) for how in ("auto", "flat"))
    assert found.true_detections > 0.97 and found.false_detections < 0.03 + 0.02 * (options.get("surfaces") == 2)
    assert found.true_detections >= flat.true_detections - 0.01


@pytest.mark.parametrize(("depth_bins", "sbr", "surfaces"), [
    (DEPTH, 0.1, 1), (WALL, 1, 1), (WALL, 10, 1), (LAYERS, 10, 1), (LAYERS, 10, 2)],
    ids=["ball", "wall", "bright", "one of two layers", "two layers that fill the view"])
def test_an_even_background_is_left_alone_bit_for_bit(depth_bins, sbr, surfaces):
    frame = simulate(make_sensor(), depth_bins, sbr)
    one, other = (reconstruct(frame, make_sensor(), how, surfaces=surfaces) for how in ("auto", "flat"))
    for field in ("depth_bins", "intensity", "background"):
        assert np.array_equal(getattr(one, field), getattr(other, field)), field


def test_an_irf_that_is_slightly_wrong_is_no_background():
    wider = np.convolve(make_sensor(1, 1).irf, [0.1, 0.8, 0.1], "same")
    frame = simulate(make_sensor(irf=wider), sbr=10, ppp=200)
    pooled = Pooled(make_sensor(), choose_frequencies("auto", make_sensor()))
    pooled(sketch_photons(frame, make_sensor(), choose_frequencies("auto", make_sensor())))
    assert pooled.uneven_background == 0


def test_a_stream_takes_one_step_a_frame_and_begins_and_ceases_with_the_fog():
    clear, foggy = make_sensor(), make_sensor(background_shape=SHAPES["fog"])
    pooled = Pooled(clear, choose_frequencies("auto", clear))
    first = [judged(pooled(sketch)) for sketch in sketches(clear, sbr=1, frames=2)]
    assert pooled.uneven_background == 0
    fog = [judged(pooled(sketch)) for sketch in sketches(foggy)]
    assert fog[0].true_detections < 0.1 and pooled.uneven_background > 0.1
    assert all(frame.true_detections > 0.97 and frame.false_detections < 0.03 for frame in fog[3:])
    again = [judged(pooled(sketch)) for sketch in sketches(clear, sbr=1)]
    assert pooled.uneven_background == 0 and again[-1].true_detections == first[-1].true_detections > 0.99


def test_forgetting_begins_anew():
    foggy, clear = make_sensor(background_shape=SHAPES["fog"]), make_sensor()
    pooled, sketch = Pooled(clear, choose_frequencies("auto", clear)), sketches(foggy, frames=1)[0]
    assert judged(pooled(sketch)).true_detections > 0.97 and pooled.uneven_background > 0.1
    pooled.forget()
    assert pooled.uneven_background == 0
    one, other = (anew(sketch) for anew in (pooled, Pooled(clear, choose_frequencies("auto", clear))))
    np.testing.assert_array_equal(one.depth_bins, other.depth_bins)
    told = Pooled(foggy, choose_frequencies("auto", foggy))                 # what the sensor says is where auto begins
    assert judged(told(sketch)).true_detections > 0.9


@pytest.mark.parametrize(("shape", "ppp"), [("ramp", 0.3), ("lump", 5), ("fog", 50)])
def test_background_alone_shows_few_points_also_where_it_is_dense(shape, ppp):
    sensor = make_sensor(background_shape=SHAPES[shape])
    assert len(reconstruct(background_alone(sensor, ppp), sensor)) <= 48        # three windows' false alarms
    assert len(reconstruct(background_alone(sensor, 50), sensor, "flat")) > 1000


@pytest.mark.parametrize("background", ["sensor", "auto"])
def test_a_hot_pixel_does_not_harm_its_neighbours(background):
    sensor = make_sensor(background_shape=SHAPES["ramp"] if background == "sensor" else None)
    frame = simulate(sensor, sbr=3, ppp=20)
    rng = np.random.default_rng(1)
    hot = rng.choice(sensor.pixels, 12, replace=False)
    frame = with_photons(frame, np.repeat(hot, 2000), rng.integers(0, T, 24_000))       # 100 times the others
    mask = ~np.isin(np.arange(sensor.pixels), hot).reshape(48, 48)
    for known in (True, False):
        cloud = reconstruct(frame, sensor.replace(mask=mask if known else None), background)
        beside = mask[cloud.row, cloud.col]
        error = circular_difference(cloud.depth_bins, DEPTH[cloud.row, cloud.col], T)
        assert beside.sum() > 0.98 * mask.sum() and (np.abs(error[beside]) > 10).mean() < 0.02
        assert beside.all() or not known
