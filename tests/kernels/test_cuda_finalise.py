"""The CUDA kernels of the end, `finalise` and `collect`, against the float64 reference and the CPU kernels."""

from dataclasses import replace

import numpy as np
import pytest

from srt3d_ros.kernels import maps

from .frames import RELATIVE, T, make_frame, make_state, make_terms
from .on_device import frame_on, others


@pytest.mark.parametrize(("shape", "surfaces", "clutter"), [((4, 40), 1, False), ((3, 33), 2, True), ((2, 5), 3, False),
                                                            ((1, 1), 1, False)])
def test_finalise(cuda, shape, surfaces, clutter):
    frame = make_frame(shape, 1)
    if clutter:
        frame = replace(frame, clutter=np.random.default_rng(0).uniform(1, 3, T).astype(np.float32))
    state, photons = make_state(frame, surfaces, 1), frame.counts.astype(np.uint32) + 3
    terms = make_terms(frame, state)
    given = frame_on(cuda, frame.padded), *map(cuda.array, (photons, state, terms))
    found = cuda.finalise(*given, 9.0, cuda.Scratch())
    intensity, std, background = (cuda.numpy(values) for values in found)
    for other in others():
        expected = other.finalise(frame.padded, photons, state, terms, 9.0)
        np.testing.assert_allclose(intensity, expected[0], rtol=RELATIVE, atol=1e-4)
        there = intensity > 0
        np.testing.assert_allclose(std[there], expected[1][there], rtol=RELATIVE)
        np.testing.assert_allclose(background, expected[2], rtol=RELATIVE, atol=1e-3)
    assert shape == (1, 1) or 0 < there.sum() < (maps.crop(state, *shape)[:, :, maps.INTENSITY] > 0).sum()


@pytest.mark.parametrize(("shape", "surfaces"), [((5, 40), 1), ((4, 33), 2), ((3, 50), 4), ((1, 1), 1)])
def test_collect(cuda, shape, surfaces):
    rng = np.random.default_rng(5)
    state = make_state(make_frame(shape, 5), surfaces, 5)
    maps.crop(state, *shape)[0, :, maps.DEPTH, 0] = T       # −ε, rounded
    intensity, std = (rng.choice([0, 1, 2, 3.5], (shape[0], surfaces, shape[1])).astype(np.float32) for _ in range(2))
    rays, places = rng.normal(size=(*shape, 3)).astype(np.float32), (0.0149, 12.5, T)
    found = cuda.unpack(cuda.collect(*map(cuda.array, (state, intensity, std, rays)), *places))
    assert len(found[0]) == (intensity > 0).sum() and (len(found[0]) > 50 or shape == (1, 1))
    for other in others():
        expected = other.collect(state, intensity, std, rays, *places)
        for one, two in zip(found[:4], expected[:4]):
            assert one.dtype == two.dtype and np.array_equal(one, two)
        np.testing.assert_allclose(found[4], expected[4], rtol=1e-6)


def test_a_frame_without_points_gives_empty_lists(cuda):
    state, none = np.zeros(maps.state_shape(3, 5, 2), np.float32), np.zeros((3, 2, 5), np.float32)
    rays = np.zeros((3, 5, 3), np.float32)
    found = cuda.unpack(cuda.collect(*map(cuda.array, (state, none, none, rays)), 1.0, 0.0, T))
    assert [values.shape for values in found] == [(0,), (0,), (0,), (5, 0), (0, 3)]
