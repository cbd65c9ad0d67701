"""The start's kernels against the reference: `prepare`, `blur`, `match`, `search`, `residual` and `drop_weak`."""

from dataclasses import replace

import numpy as np
import pytest

from srt3d_ros.core.frequencies import angular_frequencies, choose, irf_spectrum
from srt3d_ros.core.matched_frame import Matcher
from srt3d_ros.core.metrics import circular_difference
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import DOUBTFUL, REST_SCALES, SURE_SCALES

from .frames import (
    DEPTH_TOLERANCE,
    FAINT,
    REFERENCE,
    SHAPES,
    T,
    assert_states_agree,
    cases,
    exact_frame,
    make_frame,
    make_sensor,
    make_sketch,
    make_state,
    make_terms,
    with_clutter,
)

SCALES = [*SURE_SCALES, *REST_SCALES]


@pytest.mark.parametrize("shape", [(3, 40), (1, 5), (4, 1)])
@pytest.mark.parametrize("each", [False, True])
def test_prepare_makes_the_frame_of_the_matcher(backend, shape, each):
    sensor = make_sensor(*shape, seed=2)
    if each:        # an equaliser for each pixel, and masked ones
        sensor = sensor.replace(delay_bins=np.random.default_rng(0).uniform(-9, 9, shape))
    sketch = make_sketch(sensor, seed=2)
    matcher, scratch = Matcher(sensor, sketch.frequencies), backend.kernels.Scratch()
    arguments = sketch.sums, sketch.photons, matcher.equaliser, matcher.used
    expected = matcher(sketch).padded
    for name, size in (("matched", expected.matched.shape), ("counts", expected.counts.shape)):
        scratch.array(name, size)[:] = np.nan
    matched, counts = backend.prepare(*arguments, scratch)
    for kernels in (matched, REFERENCE.prepare(*arguments)[0]):
        np.testing.assert_allclose(kernels, expected.matched, atol=1e-5 * np.abs(expected.matched).max())
    np.testing.assert_array_equal(counts, expected.counts)


@pytest.mark.parametrize("shape", [SHAPES[1], (1, 1), (1, 9), (9, 1), (5, 7)])
@pytest.mark.parametrize(("sigma", "step"), [(1.0, 1), (2.0, 1), (1.0, 2), (1.5, 3), (1.0, 4)])
def test_blur(backend, shape, sigma, step):
    values = np.random.default_rng(0).normal(size=(shape[0], 3, shape[1])).astype(np.float32)
    weights = maps.window_weights(sigma)
    found, expected = backend.blur(values, weights, step), REFERENCE.blur(values, weights, step)
    np.testing.assert_allclose(found, expected, atol=1e-6 * step**2 * weights.sum()**2)


@pytest.mark.parametrize(("backend", "shape", "surfaces"), cases(
    [(SHAPES[0], 1), (SHAPES[1], 2)], [(SHAPES[0], 4), (SHAPES[1], 4)]), indirect=["backend"])
def test_match(backend, shape, surfaces):
    frame = make_frame(shape, seed=3)
    fast, slow = backend.match(frame, surfaces), REFERENCE.match(frame, surfaces)
    # The second surface is found in what the first leaves, which magnifies its errors.
    assert np.abs(circular_difference(fast[0], slow[0], T)).max() < 10 * DEPTH_TOLERANCE
    np.testing.assert_allclose(fast[1], slow[1], atol=2e-4 * slow[1].max())


@pytest.mark.parametrize("size", [1, 20])
def test_match_finds_the_highest_peak_wherever_it_lies(backend, size):
    """With one frequency there are fewer cells than are looked at together, with 20 more frequencies than 16."""
    sensor = SensorModel(1, 600, T, 1e-10, np.exp(-np.linspace(-3, 3, 25)**2))
    depth = np.linspace(0, T, 600, endpoint=False)[None]
    frequencies = choose("auto", sensor, size)
    sums = 40 * irf_spectrum(sensor, frequencies) * np.exp(1j * angular_frequencies(frequencies, T) * depth[..., None])
    sketch = Sketch(frequencies, sums.astype(np.complex64), np.full((1, 600), 40, np.uint32))
    frame = Matcher(sensor, frequencies)(sketch)
    found, intensity = backend.match(frame, 1)
    # The parabola through a band-limited peak sampled 4 times a period: a small part of the peak's width.
    assert np.abs(circular_difference(found[:, 0], depth, T)).max() < 0.1 * frame.resolution_bins
    np.testing.assert_allclose(intensity, 40, rtol=0.03)


def check_search(backend, frame, state, layer, scale, enough, carried=None):
    """The state after a search, which agrees with the reference's and leaves other points as they were."""
    arguments = frame.padded, frame.padded.matched, state, layer, *scale, enough, None, carried, 2.0
    found, expected = (kernels.changed("search", *arguments)[2] for kernels in (backend, REFERENCE))
    if frame.shape != (1, 1):
        assert (found[:, layer, maps.INTENSITY] > 0).sum() > (state[:, layer, maps.INTENSITY] > 0).sum() + 10
        assert_states_agree(found, expected, frame.shape)
    was = expected[:, layer, maps.INTENSITY] == state[:, layer, maps.INTENSITY]
    assert np.array_equal(found[:, layer].swapaxes(0, 1)[:, was], state[:, layer].swapaxes(0, 1)[:, was])
    return maps.crop(found, *frame.shape)


@pytest.mark.parametrize(("backend", "shape", "scale", "light", "clutter"), cases(
    [((4, 35), SCALES[0], 1, False), ((7, 35), SCALES[1], FAINT, False), ((7, 35), SCALES[2], FAINT, True),
     ((5, 33), SCALES[3], FAINT, False), ((9, 67), SCALES[4], FAINT, False), ((1, 1), SCALES[2], 1, False)],
    [(shape, scale, 1, False) for shape in SHAPES for scale in SCALES]), indirect=["backend"])
def test_search(backend, shape, scale, light, clutter):
    frame = make_frame(shape, 3, light)
    frame = with_clutter(frame) if clutter else frame
    state = make_state(frame, 1, 3)
    state[:, 0, maps.INTENSITY, ::3] = 0
    check_search(backend, frame, state, 0, scale, 4.0 if light < 1 else 9.0)


@pytest.mark.parametrize(("surfaces", "scale"), [(2, SCALES[0]), (2, SCALES[2]), (3, SCALES[1])])
def test_search_for_further_surfaces(backend, surfaces, scale):
    frame = make_frame((6, 35), 4)
    state = make_state(frame, surfaces, 4)
    state[:, -1, maps.INTENSITY, ::2] = 0
    state[:, :, maps.DEPTH, ::3] = (state[:, :, maps.DEPTH, ::3] + 40) % T      # so that the photons show others
    view = check_search(backend, frame, state, surfaces - 1, scale, 3.0)
    new = (view[:, [0, -1], maps.INTENSITY] > 0).all(axis=1)
    new &= maps.crop(state, *frame.shape)[:, -1, maps.INTENSITY] == 0
    apart = np.abs(circular_difference(view[:, 0, maps.DEPTH], view[:, -1, maps.DEPTH], T))[new]
    assert new.any() and apart.min() > 3.9 * frame.resolution_bins


@pytest.mark.parametrize(("surfaces", "scale", "clutter"), [(1, SCALES[0], False), (1, SCALES[2], True),
                                                            (2, SCALES[1], False)])
def test_search_keeps_carried_surfaces_that_photons_confirm(backend, surfaces, scale, clutter):
    frame = make_frame((6, 40), 2, 0.2)
    frame = with_clutter(frame) if clutter else frame
    carried = make_state(frame, surfaces, 1)
    state = make_state(frame, surfaces, 1)
    state[:, -1, maps.INTENSITY] = 0
    view = check_search(backend, frame, state, surfaces - 1, scale, 4.0, carried)
    there = view[:, -1, maps.INTENSITY] > 0
    same = view[:, -1, maps.DEPTH][there] == maps.crop(carried, *frame.shape)[:, -1, maps.DEPTH][there]
    assert same.sum() > 10 and (~same).sum() > 2


@pytest.mark.parametrize(("backend", "shape", "scale", "origin"), cases(
    [((7, 35), (2.0, 2), (0, 0)), ((5, 33), (1.5, 1), (6, 18))], [((9, 67), (3.0, 3), (24, 6))]), indirect=["backend"])
def test_search_with_slopes(backend, shape, scale, origin):
    """One after the other, as the reference; surfaces that are sure stay, and others only give way to better ones."""
    frame = replace(make_frame(shape, 3, FAINT), origin=origin)
    before = make_state(frame, 1, 3)
    before[:, 0, maps.INTENSITY, ::3] = 0
    padded, state, replaced = frame.padded, before.copy(), 0
    for slope in ((0.0, 0.0), (1.2, -0.8), (-2.0, 0.0)):
        last, arguments = state, (padded, padded.matched, state, 0, *scale, 4.0, None, None, 0.0, slope, before)
        state, expected = (kernels.changed("search", *arguments)[2] for kernels in (backend, REFERENCE))
        assert_states_agree(state, expected, shape)
        changed = (state != last).any(axis=2)[:, 0]
        assert not changed[before[:, 0, maps.INTENSITY] > 0].any()
        had = changed & (last[:, 0, maps.INTENSITY] > 0)
        assert (last[:, 0, maps.SCORE][had] < DOUBTFUL).all()
        assert (state[:, 0, maps.SCORE][had] > last[:, 0, maps.SCORE][had]).all()
        replaced += had.sum()
        if slope != (0.0, 0.0):
            assert (state[:, 0, maps.SLOPE_COL][changed] == np.float32(slope[0])).all()
            assert (state[:, 0, maps.SLOPE_ROW][changed] == np.float32(slope[1])).all()
    assert replaced > 5


@pytest.mark.parametrize("slope", [(4.0, 0.0), (-3.0, 2.0)])
def test_a_slanted_window_adds_up_what_a_flat_one_smears(backend, slope):
    row, col = np.mgrid[:9, :40]
    depth = ((290 + slope[0] * col + slope[1] * row) % T)[None]     # beyond the end of the period
    frame = exact_frame(depth, np.full(depth.shape, 5.0), 40)
    scores = []
    for tried in ((0.0, 0.0), slope):
        state = maps.no_surfaces(*frame.shape, 1)
        padded = frame.padded
        state = backend.changed("search", padded, padded.matched, state, 0, 2.0, 2, 0.1, None, None, 0.0, tried)[2]
        found = maps.crop(state, *frame.shape)[2:-2, 0, :, 4:-4]
        scores.append(found[:, maps.SCORE].min())
    assert scores[1] > 1.2 * scores[0]
    error = circular_difference(found[:, maps.DEPTH], depth[0, 2:-2, 4:-4], T)
    assert np.abs(error).max() < 0.1 * frame.resolution_bins


@pytest.mark.parametrize(("surfaces", "layer"), [(2, 1), (3, 1)])
def test_residual(backend, surfaces, layer):
    frame = make_frame((4, 33), 1)
    state = make_state(frame, surfaces, 1)
    arguments = frame.padded, state, make_terms(frame, state), layer
    found, expected = backend.residual(*arguments), REFERENCE.residual(*arguments)
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())
    assert np.abs(maps.crop(found, 4, 33)).sum() < 0.95 * np.abs(frame.matched).sum()


def test_drop_weak_removes_points_with_little_evidence_only(backend):
    state = make_state(make_frame((4, 33), 1), 2, 1)
    found, expected = (kernels.changed("drop_weak", state, 10.0)[0] for kernels in (backend, REFERENCE))
    assert np.array_equal(found, expected) and not np.array_equal(expected, state)
