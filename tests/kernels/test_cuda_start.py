"""The CUDA kernels of the start, `blur` and `match`, against the float64 reference and the CPU kernels."""

import numpy as np
import pytest

from srt3d_ros.core.frequencies import angular_frequencies, choose, irf_spectrum
from srt3d_ros.core.matched_frame import Matcher
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.kernels.windows import window_weights

from .frames import DEPTH_TOLERANCE, SHAPES, T, make_frame
from .on_device import others


@pytest.mark.parametrize("shape", [SHAPES[1], (1, 9), (9, 1)])
@pytest.mark.parametrize(("sigma", "step"), [(1.0, 1), (1.0, 2), (1.5, 3), (1.0, 4)])
def test_blur(cuda, shape, sigma, step):
    values = np.random.default_rng(0).normal(size=(shape[0], 3, shape[1])).astype(np.float32)
    weights = window_weights(sigma)
    into = cuda.array(np.full((-(-shape[0] // step), 3, -(-shape[1] // step)), np.nan, np.float32))
    arguments = cuda.array(values), cuda.array(weights), step
    found = cuda.numpy(cuda.blur(*arguments))
    assert cuda.blur(*arguments, into) is into and np.array_equal(cuda.numpy(into), found)
    for other in others():
        np.testing.assert_allclose(found, other.blur(values, weights, step), atol=1e-6 * step**2 * weights.sum()**2)


@pytest.mark.parametrize("surfaces", [1, 2])
@pytest.mark.parametrize("shape", SHAPES)
def test_match(cuda, shape, surfaces):
    frame = make_frame(shape, seed=3)
    arguments = [cuda.array(a) for a in (frame.matched, frame.energy, frame.bin_frequencies)]
    out = tuple(cuda.array(np.full((shape[0], surfaces, shape[1]), np.nan, np.float32)) for _ in range(2))
    assert cuda.match(*arguments, T, surfaces, out) is out
    depth, intensity = (cuda.numpy(a) for a in out)
    for other in others():
        expected = other.match(frame.matched, frame.energy, frame.bin_frequencies, T, surfaces)
        # The second surface is found in what the first leaves, which magnifies its errors.
        assert np.abs(circular_difference(depth, expected[0], T)).max() < 10 * DEPTH_TOLERANCE
        np.testing.assert_allclose(intensity, expected[1], atol=2e-4 * expected[1].max())


@pytest.mark.parametrize("size", [1, 20])
def test_match_finds_the_highest_peak_wherever_it_lies(cuda, size):
    """With one frequency there are fewer cells than a program looks at together, with 20 more frequencies than 16."""
    sensor = SensorModel(1, 600, T, 1e-10, np.exp(-np.linspace(-3, 3, 25)**2))
    depth = np.linspace(0, T, 600, endpoint=False)[None]
    frequencies = choose("auto", sensor, size)
    sums = 40 * irf_spectrum(sensor, frequencies) * np.exp(1j * angular_frequencies(frequencies, T) * depth[..., None])
    sketch = Sketch(frequencies, sums.astype(np.complex64), np.full((1, 600), 40, np.uint32))
    frame = Matcher(sensor, frequencies)(sketch)
    found, intensity = cuda.match(*(cuda.array(a) for a in (frame.matched, frame.energy, frame.bin_frequencies)), T, 1)
    # The parabola through a band-limited peak sampled 4 times a period: a small part of the peak's width.
    assert np.abs(circular_difference(cuda.numpy(found)[:, 0], depth, T)).max() < 0.1 * frame.resolution_bins
    np.testing.assert_allclose(cuda.numpy(intensity), 40, rtol=0.03)
