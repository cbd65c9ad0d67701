"""The end's kernels against the plain reference: intensities and their uncertainty, and the list of points."""

import numpy as np
import pytest

from srt3d_ros.core.matched_frame import Matcher
from srt3d_ros.kernels import cpu, maps, reference

from .frames import SHAPES, T, make_frame, make_sensor, make_sketch, make_state, make_terms


@pytest.mark.parametrize("surfaces", [1, 2])
@pytest.mark.parametrize("shape", SHAPES)
def test_finalise(shape, surfaces):
    frame = make_frame(shape, seed=1)
    state, photons = make_state(frame, surfaces, 1), frame.counts.astype(np.uint32)
    terms = make_terms(frame, state)
    fast, slow = (kernels.finalise(frame.padded, photons, state, terms, 6.0)
                  for kernels in (cpu, reference))
    for one, other in zip(fast, slow):
        np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-3)
    score = maps.crop(state, *shape)[:, :, maps.SCORE]
    assert (fast[0][score <= 6] == 0).all() and (fast[0] > 0).sum() > 100 and (fast[2] >= 0).all()


@pytest.mark.parametrize("surfaces", [1, 3])
def test_collect_lists_points_by_pixel_the_strongest_first(surfaces):
    shape = SHAPES[1]
    state = make_state(make_frame(shape, seed=1), surfaces, 1)
    view = maps.crop(state, *shape)
    intensity, std = (np.ascontiguousarray(view[:, :, field]) for field in (maps.INTENSITY, maps.STD))
    intensity[2, :, 3] = 5.0                                    # equally strong: in the order of the layers
    view[4, 0, maps.DEPTH, 5], intensity[4, 0, 5] = T, 7.0    # rounded up: the period's end is its beginning
    rays = np.random.default_rng(0).normal(size=(*shape, 3)).astype(np.float32)
    fast, slow = (kernels.collect(state, intensity, std, rays, 0.01, 0.5, T) for kernels in (cpu, reference))
    for one, other in zip(fast, slow):
        assert one.dtype == other.dtype and one.shape == other.shape
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-6)
    assert (fast[3][0] < T).all() and len(fast[0]) == (intensity > 0).sum()


def test_collect_of_nothing_is_empty():
    state = maps.no_surfaces(3, 4, 2)
    nothing = np.zeros((3, 2, 4), np.float32)
    row, col, rank, values, xyz = cpu.collect(state, nothing, nothing, np.ones((3, 4, 3), np.float32), 1.0, 0.0, T)
    assert row.shape == col.shape == rank.shape == (0,) and values.shape == (5, 0) and xyz.shape == (0, 3)


@pytest.mark.parametrize("shape", SHAPES)
def test_prepare_makes_the_frame_of_the_matcher(shape):
    sensor = make_sensor(*shape, seed=6)
    sketch = make_sketch(sensor, 6)
    matcher = Matcher(sensor, sketch.frequencies)
    matched, counts = cpu.prepare(sketch.sums, sketch.photons, matcher.equaliser, matcher.used)
    expected = matcher(sketch).padded
    np.testing.assert_allclose(matched, expected.matched, atol=1e-5 * np.abs(expected.matched).max())
    np.testing.assert_array_equal(counts, expected.counts)
