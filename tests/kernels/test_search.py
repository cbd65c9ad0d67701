"""The start's kernels against the plain reference: a scale that finds surfaces, the last frame's among them."""

import numpy as np
import pytest

from srt3d_ros.kernels import cpu, maps, reference
from srt3d_ros.kernels.constants import REST_SCALES, SURE_SCALES

from .frames import SHAPES, assert_states_agree, make_frame, make_state, make_terms

SCALES = [*SURE_SCALES, *REST_SCALES]


def searched(kernels, frame, state, layer, scale, **options):
    state = state.copy()
    kernels.search(frame, frame.matched, state, layer, *scale, 4.0, **options)
    return state


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("shape", SHAPES)
def test_search_of_first_surfaces(shape, scale):
    frame = make_frame(shape, seed=2).padded
    state = maps.no_surfaces(*shape, 1)
    known = make_state(make_frame(shape, seed=2), 1, 0)
    state[:, :, maps.INTENSITY, ::3] = known[:, :, maps.INTENSITY, ::3]
    fast, slow = (searched(kernels, frame, state, 0, scale) for kernels in (cpu, reference))
    assert_states_agree(fast, slow, shape)
    known = state[:, 0, maps.INTENSITY] > 0
    np.testing.assert_array_equal(fast[:, 0].swapaxes(1, 2)[known], state[:, 0].swapaxes(1, 2)[known])


@pytest.mark.parametrize("scale", SCALES[:3])
def test_search_of_second_surfaces_leaves_out_what_is_not_resolved_from_the_first(scale):
    shape = SHAPES[1]
    frame = make_frame(shape, seed=2)
    state = make_state(frame, 2, 3)
    state[:, 1] = 0
    fast, slow = (searched(kernels, frame.padded, state, 1, scale) for kernels in (cpu, reference))
    assert_states_agree(fast, slow, shape)
    view = maps.crop(fast, *shape)
    both = (view[:, :, maps.INTENSITY] > 0).all(axis=1)
    apart = np.abs(view[:, 0, maps.DEPTH] - view[:, 1, maps.DEPTH])[both]
    assert both.any() and np.minimum(apart, frame.num_bins - apart).min() > 3.9 * frame.resolution_bins


@pytest.mark.parametrize("scale", SCALES[:3])
def test_search_keeps_carried_surfaces_that_photons_confirm(scale):
    shape = SHAPES[0]
    frame = make_frame(shape, seed=2, light=0.2)
    carried = make_state(frame, 1, 1)
    fast, slow, without = (searched(kernels, frame.padded, maps.no_surfaces(*shape, 1), 0, scale, **options)
                           for kernels, options in ((cpu, {"carried": carried, "confirmed": 2.0}),
                                                    (reference, {"carried": carried, "confirmed": 2.0}), (cpu, {})))
    assert_states_agree(fast, slow, shape)
    there = [(state[:, 0, maps.INTENSITY] > 0).sum() for state in (fast, without)]
    same = fast[:, 0, maps.DEPTH] == carried[:, 0, maps.DEPTH]
    kept = same & (fast[:, 0, maps.INTENSITY] > 0)
    assert there[0] >= there[1] + (scale[0] == 0) and kept.sum() > 5
    astray = (carried[:, 0, maps.INTENSITY] > 0) & (fast[:, 0, maps.INTENSITY] > 0) & ~same
    assert astray.sum() > 5                                     # where the photons say otherwise


def test_residual_takes_out_what_each_pixel_shows_of_its_first_surface():
    shape = SHAPES[1]
    frame = make_frame(shape, seed=4)
    state = make_state(frame, 2, 4)
    terms = make_terms(frame, state)
    fast, slow = (kernels.residual(frame.padded, state, terms, 1) for kernels in (cpu, reference))
    np.testing.assert_allclose(maps.crop(fast, *shape), maps.crop(slow, *shape), atol=1e-4 * np.abs(slow).max())
    assert np.abs(maps.crop(fast, *shape)).sum() < 0.95 * np.abs(frame.matched).sum()


def test_drop_weak_removes_points_with_little_evidence_only():
    state = make_state(make_frame(SHAPES[0], seed=0), 2, 0)
    before = state.copy()
    cpu.drop_weak(state, 10.0)
    weak = before[:, :, maps.SCORE] < 10
    assert (state[:, :, maps.INTENSITY][weak] == 0).all() and (before[:, :, maps.INTENSITY][weak] > 0).any()
    np.testing.assert_array_equal(state[:, :, maps.INTENSITY][~weak], before[:, :, maps.INTENSITY][~weak])
