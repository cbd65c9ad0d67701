"""The CPU kernels against the plain reference, step by step and for whole reconstructions; and that they repeat."""

import numba
import numpy as np
import pytest

from srt3d_ros.core.frequencies import angular_frequencies, choose, irf_spectrum
from srt3d_ros.core.matched_frame import Matcher
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.kernels import cpu, maps, reference
from srt3d_ros.kernels.windows import window_weights

from .frames import (
    DEPTH_TOLERANCE,
    FAINT,
    GATE,
    RELATIVE,
    SHAPES,
    SHARE_AT_TIES,
    T,
    make_frame,
    make_sensor,
    make_sketch,
    make_state,
    make_terms,
)


@pytest.mark.parametrize("shape", [*SHAPES, (1, 1), (1, 9), (9, 1), (5, 7)])
@pytest.mark.parametrize(("sigma", "step"), [(1.0, 1), (2.0, 1), (1.0, 2), (1.5, 3), (1.0, 4)])
def test_blur(shape, sigma, step):
    values = np.random.default_rng(0).normal(size=(shape[0], 3, shape[1])).astype(np.float32)
    weights = window_weights(sigma)
    expected = reference.blur(values, weights, step)
    np.testing.assert_allclose(cpu.blur(values, weights, step), expected, atol=1e-6 * step**2 * weights.sum()**2)


@pytest.mark.parametrize("surfaces", [1, 2, 4])
@pytest.mark.parametrize("shape", SHAPES)
def test_match(shape, surfaces):
    frame = make_frame(shape, seed=3)
    arguments = frame.matched, frame.energy, frame.bin_frequencies, T, surfaces
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
    found, intensity = cpu.match(frame.matched, frame.energy, frame.bin_frequencies, T, 1)
    # The parabola through a band-limited peak sampled 4 times a period: a small part of the peak's width.
    assert np.abs(circular_difference(found[:, 0], depth, T)).max() < 0.1 * frame.resolution_bins
    np.testing.assert_allclose(intensity, 40, rtol=0.03)


def test_nothing_appears_outside_the_image_or_in_masked_pixels():
    frame = make_frame((9, 33), seed=1)
    state = make_state(frame, 2, seed=1)
    terms = make_terms(frame, state)
    for after in (cpu.birth_death(frame.padded, state, terms, GATE),
                  cpu.pooled_step(frame.padded, state, terms, 2.0, 3, GATE)):
        points = after[:, :, maps.INTENSITY] > 0
        assert not points[frame.padded.exposure[:, None].repeat(2, axis=1) == 0].any()
        assert np.isfinite(after).all()


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("surfaces", "light"), [(1, 1), (1, FAINT), (2, 1), (2, 0.1)])
def test_whole_reconstructions_agree(shape, surfaces, light):
    sensor = make_sensor(*shape, seed=5)
    sketch = make_sketch(sensor, 5, light)
    fast, slow = (Pooled(sensor, sketch.frequencies, surfaces=surfaces, device=device)(sketch)
                  for device in ("cpu", "reference"))
    assert_clouds_agree(fast, slow, surfaces, sketch)


@pytest.mark.parametrize("surfaces", [1, 2])
def test_warm_reconstructions_agree(surfaces):
    sensor = make_sensor(6, 40, seed=5)
    first, second = make_sketch(sensor, 5), make_sketch(sensor, 6, 0.2)
    clouds = []
    for device in ("cpu", "reference"):
        reconstructor = Pooled(sensor, first.frequencies, surfaces, device=device, warm_start=True)
        reconstructor(first)
        clouds.append(reconstructor(second))
    assert_clouds_agree(*clouds, surfaces, second)
    without = Pooled(sensor, first.frequencies, surfaces, device="cpu")(second)
    assert not np.array_equal(without.depth_bins, clouds[0].depth_bins)


def assert_clouds_agree(fast, slow, surfaces, sketch):
    """But for ties."""
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
