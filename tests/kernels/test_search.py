"""The start's kernels against the oracle: `prepare`, `blur`, `match`, `search` and `residual`."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequencies import angular_frequencies, choose_frequencies, irf_spectrum
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import SLANT, SLANTED_SCORE, START_SCALES, STEEPER, SURE_SCORE, WIDE_SCALE, cell_size
from tests.core.scenes import matched_frame

from .frames import (
    CPU,
    DEPTH_TOLERANCE,
    FAINT,
    FARTHEST_AT_TIES,
    ORACLE,
    RELATIVE,
    SHAPES,
    SHARE_AT_TIES,
    T,
    assert_states_agree,
    exact_frame,
    make_frame,
    make_state,
    make_terms,
    padded,
    with_clutter,
)

SCALES = [*((sigma, cell_size(sigma)) for sigma in (*START_SCALES, WIDE_SCALE)), (3.0, 2)]


@pytest.mark.parametrize("shape", [SHAPES[1], (1, 1), (1, 9), (9, 1), (5, 7)])
@pytest.mark.parametrize("sigma", [1.0, 2.0])
def test_blur(shape, sigma):
    values = np.random.default_rng(0).normal(size=(shape[0], 3, shape[1])).astype(np.float32)
    found, expected = (kernels.blur(values, sigma) for kernels in (CPU, ORACLE))
    np.testing.assert_allclose(found, expected, atol=1e-6 * maps.window_weights(sigma).sum()**2)


@pytest.mark.parametrize("size", [1, 20])
def test_match_finds_the_highest_peak_wherever_it_lies(backend, size):
    """With one frequency there are fewer cells than are looked at together, with 20 more frequencies than 16."""
    sensor = SensorModel(1, 600, T, 1e-10, np.exp(-np.linspace(-3, 3, 25)**2))
    depth = np.linspace(0, T, 600, endpoint=False)[None]
    frequencies = choose_frequencies("auto", sensor, size)
    sums = 40 * irf_spectrum(sensor, frequencies) * np.exp(1j * angular_frequencies(frequencies, T) * depth[..., None])
    sketch = PhaseSums(frequencies, sums.astype(np.complex64), np.full((1, 600), 40, np.uint32), sensor=sensor)
    frame = matched_frame(sensor, sketch)
    found, intensity = (maps.crop(each, *frame.shape) for each in backend.match(padded(frame), 1))
    # The parabola through a band-limited peak sampled 4 times a period: a small part of the peak's width.
    assert np.abs(circular_difference(found[:, 0], depth, T)).max() < 0.1 * frame.resolution_bins
    np.testing.assert_allclose(intensity, 40, rtol=0.03)


@pytest.mark.parametrize(("shape", "surfaces", "light"), [((6, 40), 1, FAINT), ((9, 33), 2, 1), ((5, 7), 3, 1)])
def test_match(shape, surfaces, light):
    frame = make_frame(shape, 4, light)
    found, expected = ([maps.crop(each, *shape) for each in kernels.match(padded(frame), surfaces)]
                       for kernels in (CPU, ORACLE))
    seen = (frame.counts > 0)[:, None] & (expected[1] > 0)
    apart = np.abs(circular_difference(found[0], expected[0], T))
    wrong = apart > surfaces * DEPTH_TOLERANCE      # each is found in what those before leave
    assert apart[seen].max() <= FARTHEST_AT_TIES * DEPTH_TOLERANCE
    wrong |= np.abs(found[1] - expected[1]) > RELATIVE * np.abs(expected[1]) + 1e-5
    assert seen.sum() > 20 and (wrong & seen).sum() <= seen.sum() * SHARE_AT_TIES
    assert (found[1][(frame.counts == 0)[:, None].repeat(surfaces, 1)] == 0).all()


@pytest.mark.parametrize(("shape", "surfaces", "layer"), [((6, 40), 2, 1), ((9, 33), 2, 0), ((5, 7), 4, 3)])
def test_residual(shape, surfaces, layer):
    frame = make_frame(shape, 4)
    state = make_state(frame, surfaces, 4)
    arguments = padded(frame), state, make_terms(frame, state), layer
    found, expected = (maps.crop(kernels.residual(*arguments), *shape) for kernels in (CPU, ORACLE))
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())
    assert np.abs(expected - maps.crop(padded(frame).matched, *shape)).max() > 0.1


def check_search(frame, state, layer, scale, enough):
    """A search, which agrees with the oracle's and leaves other points as they were."""
    arguments = padded(frame), padded(frame).matched, state, layer, *scale, enough
    found, expected = (kernels.changed("search", *arguments)[2] for kernels in (CPU, ORACLE))
    if frame.shape != (1, 1):
        assert (found[:, layer, maps.INTENSITY] > 0).sum() > (state[:, layer, maps.INTENSITY] > 0).sum() + 10
        assert_states_agree(found, expected, frame.shape)
    was = expected[:, layer, maps.INTENSITY] == state[:, layer, maps.INTENSITY]
    assert np.array_equal(found[:, layer].swapaxes(0, 1)[:, was], state[:, layer].swapaxes(0, 1)[:, was])


@pytest.mark.parametrize(("shape", "surfaces", "scale", "light", "clutter"), [
    ((6, 35), 1, SCALES[0], 1, False), ((7, 35), 1, SCALES[1], FAINT, False), ((7, 35), 1, SCALES[2], FAINT, True),
    ((5, 33), 1, SCALES[3], FAINT, False), ((9, 67), 1, SCALES[4], FAINT, False), ((1, 1), 1, SCALES[2], 1, False),
    ((6, 35), 2, SCALES[0], 1, False), ((6, 35), 2, SCALES[2], 1, False), ((6, 35), 3, SCALES[1], 1, False)])
def test_search(shape, surfaces, scale, light, clutter):
    frame = make_frame(shape, 3, light)
    frame = with_clutter(frame) if clutter else frame
    state = make_state(frame, surfaces, 3)
    state[:, -1, maps.INTENSITY, ::3] = 0
    check_search(frame, state, surfaces - 1, scale, 4.0 if light < 1 else 9.0 if surfaces == 1 else 3.0)


def make_steep_frame(shape, sigma):
    """A wall and steep planes, each of 13 columns, with the noise of a few photons."""
    row, col = np.mgrid[:shape[0], :shape[1]]
    rise = 1.5 / sigma * exact_frame(np.ones((1, *shape)), np.ones((1, *shape)), 2.0).resolution_bins
    depth = T / 2 + rise * np.choose(col // 13 % 3, [0 * col, col, row - col])
    light = 8 / sigma**2
    frame = exact_frame(depth[None], np.full((1, *shape), light), 4 * light)
    noise = np.random.default_rng(0).normal(size=frame.matched.shape) * np.sqrt(2.5 * light * frame.energy.mean())
    return replace(frame, matched=(frame.matched + noise).astype(np.float32))


@pytest.mark.parametrize(("shape", "scale"), [((9, 67), (2.0, 2)), ((5, 33), (1.0, 1)), ((9, 67), (3.0, 3))])
def test_slanted_windows_fill_and_replace_what_flat_ones_leave_or_doubt(shape, scale):
    frame = make_steep_frame(shape, scale[0])
    before = np.zeros(maps.state_shape(*shape, 1), np.float32)
    before[:, 0, maps.INTENSITY, ::3] = 1
    arguments = padded(frame), padded(frame).matched, before, 0, *scale, 4.0
    (_, _, flat, *_), (_, _, found, *_) = (CPU.changed("search", *arguments, slanted) for slanted in (False, True))
    assert_states_agree(found, ORACLE.changed("search", *arguments, True)[2], shape)
    changed = (found != flat).any(axis=2)[:, 0]
    assert changed.any() and not changed[before[:, 0, maps.INTENSITY] > 0].any()
    had, score = changed & (flat[:, 0, maps.INTENSITY] > 0), found[:, 0, maps.SCORE]
    assert (flat[:, 0, maps.SCORE][had] < SURE_SCORE).all() and (score[changed] > SLANTED_SCORE).all()
    assert (score[had]**2 > STEEPER * flat[:, 0, maps.SCORE][had]**2).all()


def test_slanted_windows_find_planes_in_eight_directions(backend):
    row, col = np.mgrid[:16, :16] - 8
    rise = SLANT * exact_frame(np.ones((1, 16, 16)), np.ones((1, 16, 16)), 2.0).resolution_bins
    for down, right in product((-1, 0, 1), repeat=2):
        depth = T / 2 + rise * (down * row + right * col)[None]
        frame = padded(exact_frame(depth, np.full((1, 16, 16), 3.0), 2.0))
        state = np.zeros(maps.state_shape(16, 16, 1), np.float32)
        found = backend.changed("search", frame, frame.matched, state, 0, 1.0, 1, 5.0, True)[2]
        slopes = maps.crop(found, 16, 16)[4:-4, 0, [maps.SLOPE_COL, maps.SLOPE_ROW], 4:-4]
        np.testing.assert_allclose(slopes, np.broadcast_to(np.array([[right], [down]]) * rise, slopes.shape), rtol=1e-5)
