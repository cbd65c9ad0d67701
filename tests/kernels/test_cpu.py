"""The CPU kernels against the plain reference, step by step and for whole reconstructions; and that they repeat."""

import numba
import numpy as np
import pytest

from srt3d_ros.core import layout
from srt3d_ros.core.frame import Matcher
from srt3d_ros.core.frequencies import angular_frequencies, choose, irf_spectrum
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.core.start import window_weights
from srt3d_ros.kernels import cpu

from . import reference
from .frames import (
    DEPTH_TOLERANCE,
    FAINT,
    GATE,
    RELATIVE,
    SHAPES,
    SHARE_AT_TIES,
    STATES,
    T,
    assert_states_agree,
    exact_state,
    make_frame,
    make_sensor,
    make_sketch,
    make_state,
)


@pytest.mark.parametrize("shape", [*SHAPES, (1, 1), (1, 9), (9, 1), (5, 7)])
@pytest.mark.parametrize(("sigma", "step"), [(1.0, 1), (2.0, 2), (4.0, 4)])
def test_blur(shape, sigma, step):
    values = np.random.default_rng(0).normal(size=(shape[0], 3, shape[1])).astype(np.float32)
    weights = window_weights(sigma, step)
    expected = reference.blur(values, weights, step)
    np.testing.assert_allclose(cpu.blur(values, weights, step), expected, atol=1e-6 * weights.sum()**2)


@pytest.mark.parametrize("surfaces", [1, 2, 4])
@pytest.mark.parametrize("shape", SHAPES)
def test_match(shape, surfaces):
    frame = make_frame(shape, seed=3)
    arguments = frame.matched, frame.energy, frame.cycles, T, surfaces
    fast, slow = cpu.match(*arguments), reference.match(*arguments)
    # The second surface is found in what the first leaves, which magnifies its errors.
    assert np.abs(circular_difference(fast[0], slow[0], T)).max() < 10 * DEPTH_TOLERANCE
    np.testing.assert_allclose(fast[1], slow[1], atol=2e-4 * slow[1].max())


def test_match_finds_the_highest_peak_wherever_it_lies():
    sensor = SensorModel(1, 600, T, 1e-10, np.exp(-np.linspace(-3, 3, 25)**2))
    depth = np.linspace(0, T, 600, endpoint=False)[None]
    frequencies = choose("auto", sensor, 10)
    sums = 40 * irf_spectrum(sensor, frequencies) * np.exp(1j * angular_frequencies(frequencies, T) * depth[..., None])
    sketch = Sketch(frequencies, sums.astype(np.complex64), np.full((1, 600), 40, np.uint32))
    frame = Matcher(sensor, frequencies)(sketch)
    found, intensity = cpu.match(frame.matched, frame.energy, frame.cycles, T, 1)
    # The parabola through a band-limited peak sampled 4 times a period: a small part of the peak's width.
    assert np.abs(circular_difference(found[:, 0], depth, T)).max() < 0.1 * frame.resolution_bins
    np.testing.assert_allclose(intensity, 40, rtol=0.03)


@pytest.mark.parametrize("radius", [1, 3, layout.MARGIN])
@pytest.mark.parametrize(("shape", "surfaces", "seed"), STATES[::3])
def test_descend(shape, surfaces, seed, radius):
    frame = make_frame(shape, seed)
    state = make_state(frame, surfaces, seed)
    before = state.copy()
    fast = cpu.descend(frame.padded, state, radius, GATE)
    assert np.array_equal(state, before)
    assert_states_agree(fast, reference.descend(frame.padded, state, radius, GATE), shape)


@pytest.mark.parametrize(("shape", "surfaces", "seed"), STATES[::2])
def test_own_intensity(shape, surfaces, seed):
    frame = make_frame(shape, seed)
    state = make_state(frame, surfaces, seed)
    fast, slow = cpu.own_intensity(frame.padded, state), reference.own_intensity(frame.padded, state)
    np.testing.assert_allclose(fast, slow, atol=1e-5 * np.abs(slow).max())


@pytest.mark.parametrize(("shape", "surfaces", "seed"), [*STATES[::2], ((6, 40), 4, 3)])
def test_explain(shape, surfaces, seed):
    frame = make_frame(shape, seed)
    state = make_state(frame, surfaces, seed)
    fast, slow = cpu.explain(frame.padded, state), reference.explain(frame.padded, state)
    np.testing.assert_allclose(fast, slow, atol=1e-5 * np.abs(slow).max())
    assert surfaces == 1 or all(not np.allclose(fast[k], frame.padded.matched) for k in range(surfaces))


@pytest.mark.parametrize("radius", [2, layout.MARGIN])
@pytest.mark.parametrize(("shape", "surfaces", "seed"), STATES[::3])
def test_relief(shape, surfaces, seed, radius):
    state = make_state(make_frame(shape, seed), surfaces, seed)
    fast = cpu.relief(state, 2.5, radius, GATE, T)
    np.testing.assert_allclose(fast, reference.relief(state, 2.5, radius, GATE, T), rtol=RELATIVE, atol=1e-4)
    assert (fast > 0.1).sum() > 100 and (fast[state[:, :, layout.INTENSITY] == 0] == 0).all()


@pytest.mark.parametrize("wrong", [0, 0.3])
def test_relief_is_the_distance_of_the_neighbours_from_the_plane(wrong):
    y, x = np.mgrid[:13, :33]
    depth = (290 + 0.6 * x - 0.4 * y)[None] % T
    state = exact_state(depth, np.ones(depth.shape))
    view = layout.crop(state, 13, 33)
    view[:, :, layout.SLOPE_COL], view[:, :, layout.SLOPE_ROW] = 0.6 - wrong, -0.4
    found = layout.crop(cpu.relief(state, 3.0, 4, 1e8, T), 13, 33)[4:-4, 0, 4:-4]
    dy, dx = np.mgrid[-4:5:2, -4:5:2]
    near = np.exp(-(dx**2 + dy**2) / (2 * 3.0**2)) * ((dx != 0) | (dy != 0))
    np.testing.assert_allclose(found, wrong * np.sqrt((near * dx**2).sum() / near.sum()), rtol=1e-3, atol=1e-3)


def test_nothing_appears_outside_the_image_or_in_masked_pixels():
    frame = make_frame((9, 33), seed=1)
    state = make_state(frame, 2, seed=1)
    for after in (cpu.propose(frame.padded, state, 2.0, GATE, 2), cpu.descend(frame.padded, state, 3, GATE)):
        points = after[:, :, layout.INTENSITY] > 0
        assert not points[frame.padded.exposure[:, None].repeat(2, axis=1) == 0].any()
        assert np.isfinite(after).all()


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("surfaces", "light"), [(1, 1), (1, FAINT), (2, 1), (2, 0.1)])
def test_whole_reconstructions_agree(shape, surfaces, light, monkeypatch):
    sensor = make_sensor(*shape, seed=5)
    sketch = make_sketch(sensor, 5, light)
    fast = Pooled(sensor, sketch.frequencies, surfaces=surfaces)(sketch)
    monkeypatch.setattr("srt3d_ros.core.pooled.kernels_for", lambda device: (device, reference))
    slow = Pooled(sensor, sketch.frequencies, surfaces=surfaces)(sketch)
    for k in range(surfaces):
        depth = [cloud.image("depth_bins", k) for cloud in (fast, slow)]
        there = np.isfinite(depth[0])
        differ = there != np.isfinite(depth[1])
        agree = np.abs(circular_difference(*depth, T)) <= DEPTH_TOLERANCE
        for field in ("intensity", "depth_std_bins"):
            one, other = (cloud.image(field, k) for cloud in (fast, slow))
            agree &= np.abs(one - other) <= RELATIVE * other
        assert there.sum() > 80 and (differ | (there & ~agree)).sum() <= there.sum() * SHARE_AT_TIES
    np.testing.assert_allclose(fast.background, slow.background, atol=1e-3 * sketch.photons.max())


def test_results_are_the_same_to_the_bit_for_any_number_of_threads_and_every_time():
    sensor = make_sensor(40, 70, seed=7)
    sketch = make_sketch(sensor, seed=7)
    srt3d = Pooled(sensor, sketch.frequencies, surfaces=2)
    before = numba.get_num_threads()
    clouds = []
    try:
        for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS), 1):
            numba.set_num_threads(threads)
            clouds.append(srt3d(sketch))
    finally:
        numba.set_num_threads(before)
    for other in clouds[1:]:
        for field in ("row", "col", "depth_bins", "intensity", "depth_std_bins", "xyz", "surface", "background"):
            assert np.array_equal(getattr(clouds[0], field), getattr(other, field)), field
    assert len(clouds[0]) > 1_000
