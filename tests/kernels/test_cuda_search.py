"""The CUDA kernels of the start: `prepare`, `search` and `residual`, against the float64 reference and the CPU's."""

from dataclasses import replace

import numpy as np
import pytest

from srt3d_ros.core.matched_frame import Matcher
from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import REST_SCALES, SURE_SCALES

from .frames import FAINT, T, assert_states_agree, make_frame, make_sensor, make_sketch, make_state, make_terms
from .on_device import frame_on, others


@pytest.mark.parametrize("shape", [(3, 40), (1, 5), (4, 1)])
@pytest.mark.parametrize("each", [False, True])
def test_prepare(cuda, shape, each):
    sensor = make_sensor(*shape, seed=2)
    if each:        # an equaliser for each pixel, and masked ones
        sensor = sensor.replace(delay_bins=np.random.default_rng(0).uniform(-9, 9, shape))
    sketch = make_sketch(sensor, seed=2)
    matcher = Matcher(sensor, sketch.frequencies)
    arguments = sketch.sums, sketch.photons, matcher.equaliser, matcher.used
    scratch, (padded_rows, padded_cols) = cuda.Scratch(), maps.padded_shape(*shape)
    for padded in (scratch.array("matched", (padded_rows, 2 * len(sketch.frequencies), padded_cols)),
                   scratch.array("counts", (padded_rows, padded_cols))):
        padded.fill_(np.nan)
    found = [cuda.numpy(maps) for maps in cuda.prepare(*(cuda.array(a) for a in arguments), scratch)]
    for other in others():
        for one, expected in zip(found, other.prepare(*arguments)):
            np.testing.assert_allclose(one, expected, atol=1e-5 * np.abs(expected).max())


SCALES = [*SURE_SCALES, *REST_SCALES]


@pytest.mark.parametrize(("shape", "scale", "light", "clutter"), [
    ((4, 35), SCALES[0], 1, False), ((7, 35), SCALES[1], FAINT, False), ((7, 35), SCALES[2], FAINT, True),
    ((5, 33), SCALES[3], FAINT, False), ((9, 67), SCALES[4], FAINT, False), ((1, 1), SCALES[2], 1, False)])
def test_search(cuda, shape, scale, light, clutter):
    frame = make_frame(shape, 3, light)
    if clutter:
        frame = replace(frame, clutter=np.random.default_rng(0).uniform(1, 3, T).astype(np.float32))
    state = make_state(frame, 1, 3)
    state[:, 0, maps.INTENSITY, ::3] = 0
    check_search(cuda, frame, state, 0, scale, 4.0 if light < 1 else 9.0)


@pytest.mark.parametrize(("surfaces", "scale"), [(2, SCALES[0]), (2, SCALES[2]), (3, SCALES[1])])
def test_search_for_further_surfaces(cuda, surfaces, scale):
    frame = make_frame((6, 35), 4)
    state = make_state(frame, surfaces, 4)
    state[:, -1, maps.INTENSITY, ::2] = 0
    state[:, :, maps.DEPTH, ::3] = (state[:, :, maps.DEPTH, ::3] + 40) % T      # so that the photons show others
    check_search(cuda, frame, state, surfaces - 1, scale, 3.0)


@pytest.mark.parametrize(("surfaces", "scale", "clutter"), [(1, SCALES[0], False), (1, SCALES[2], True),
                                                            (2, SCALES[1], False)])
def test_search_keeps_carried_surfaces_that_photons_confirm(cuda, surfaces, scale, clutter):
    frame = make_frame((6, 40), 2, 0.2)
    if clutter:
        frame = replace(frame, clutter=np.random.default_rng(0).uniform(1, 3, T).astype(np.float32))
    carried = make_state(frame, surfaces, 1)
    state = make_state(frame, surfaces, 1)
    state[:, -1, maps.INTENSITY] = 0
    found = check_search(cuda, frame, state, surfaces - 1, scale, 4.0, carried)
    there = found[:, -1, maps.INTENSITY] > 0
    same = found[:, -1, maps.DEPTH][there] == carried[:, -1, maps.DEPTH][there]
    assert same.sum() > 10 and (~same).sum() > 2


def check_search(cuda, frame, state, layer, scale, enough, carried=None):
    given, padded = cuda.array(state), frame.padded
    on, last = frame_on(cuda, padded), None if carried is None else cuda.array(carried)
    cuda.search(on, on.matched, given, layer, *scale, enough, cuda.Scratch(), last, 2.0)
    found, before = cuda.numpy(given), (state[:, layer, maps.INTENSITY] > 0).sum()
    if frame.shape != (1, 1):
        assert (found[:, layer, maps.INTENSITY] > 0).sum() > before + 10
    for other in others():
        expected = state.copy()
        other.search(padded, padded.matched, expected, layer, *scale, enough, None, carried, 2.0)
        if frame.shape != (1, 1):
            assert_states_agree(found, expected, frame.shape)
        was = expected[:, layer, maps.INTENSITY] == state[:, layer, maps.INTENSITY]
        assert np.array_equal(found[:, layer].swapaxes(0, 1)[:, was], state[:, layer].swapaxes(0, 1)[:, was])
    return found


@pytest.mark.parametrize(("surfaces", "layer"), [(2, 1), (3, 1)])
def test_residual(cuda, surfaces, layer):
    frame = make_frame((4, 33), 1)
    state = make_state(frame, surfaces, 1)
    terms, frame = make_terms(frame, state), frame.padded
    given = frame_on(cuda, frame), cuda.array(state), cuda.array(terms)
    found = cuda.numpy(cuda.residual(*given, layer, cuda.Scratch()))
    for other in others():
        expected = other.residual(frame, state, terms, layer)
        np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())
    assert not np.allclose(found, frame.matched)


def test_weak_points_are_dropped(cuda):
    state = make_state(make_frame((4, 33), 1), 2, 1)
    found = cuda.array(state)
    cuda.drop_weak(found, 10.0)
    expected = state.copy()
    expected[:, :, maps.INTENSITY][state[:, :, maps.SCORE] < 10] = 0
    assert np.array_equal(cuda.numpy(found), expected) and not np.array_equal(expected, state)
