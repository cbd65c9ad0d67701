"""The end's kernels against the oracle: intensities and their uncertainty, and the list of points."""

import numpy as np
import pytest

from srt3d_ros.kernels import maps

from .frames import CPU, ORACLE, RELATIVE, SHAPES, T, make_frame, make_state, make_terms, padded, with_clutter


@pytest.mark.parametrize(("shape", "surfaces", "clutter"), [
    ((4, 40), 1, False), ((3, 33), 2, True), (SHAPES[1], 3, False), ((1, 1), 1, False)])
def test_finalise(shape, surfaces, clutter):
    frame = make_frame(shape, 1)
    frame = with_clutter(frame) if clutter else frame
    state, photons = make_state(frame, surfaces, 1), frame.counts + 3
    arguments = padded(frame), photons, state, make_terms(frame, state), 9.0
    (points, *found), (wanted, *expected) = (each.finalise(*arguments) for each in (CPU, ORACLE))
    (intensity, std), (wanted_intensity, wanted_std) = (
        [maps.crop(each, *shape)[:, :, field] for field in (maps.INTENSITY, maps.STD)] for each in (points, wanted))
    there = intensity > 0
    np.testing.assert_allclose(intensity, wanted_intensity, rtol=RELATIVE, atol=1e-4)
    np.testing.assert_allclose(std[there], wanted_std[there], rtol=RELATIVE)
    np.testing.assert_allclose(found, expected, rtol=RELATIVE, atol=1e-3)
    view = maps.crop(state, *shape)
    assert shape == (1, 1) or 0 < there.sum() < (view[:, :, maps.INTENSITY] > 0).sum()
    assert clutter or (intensity[view[:, :, maps.SCORE] <= 9] == 0).all()


@pytest.mark.parametrize("surfaces", [1, 2])
@pytest.mark.parametrize(("share", "rough", "smooth"), [(0.2, 0, 0), (4, 24, 40), (1.2, 96, 96)])
def test_points_are_less_sure_where_their_own_photons_contradict_them(surfaces, share, rough, smooth):
    """In windows or, if too little for one, everywhere: before the column `rough`, `share` of the noise is seen."""
    frame = make_frame((9, 96), 1)
    state = make_state(frame, surfaces, 1)
    view, terms = maps.crop(state, *frame.shape), make_terms(frame, state)
    view[:, :, [maps.DEPTH, maps.SLOPE_COL, maps.SLOPE_ROW]] = np.array([20, 0.5, 0])[:, None]
    view[:, :, maps.DEPTH] += 0.5 * np.arange(96)
    view[:, :, maps.STD], view[:, :, maps.RESIDUAL] = 0.05, 0
    signal = view[:, :, maps.INTENSITY] * frame.exposure[:, None]
    variance = signal * frame.moments[0] + (frame.counts[:, None] - signal) * frame.moments[1]
    shown = np.sqrt(variance.clip(min=0)) * np.where(np.arange(96) < rough, share, 0.2)
    maps.crop(terms, *frame.shape)[:, :, maps.GRADIENT] = shown
    (points, *_), (wanted, *_) = (
        each.finalise(padded(frame), frame.counts + 3, state, terms, 1.0) for each in (CPU, ORACLE))
    found, expected = (maps.crop(each, *frame.shape)[:, :, maps.STD] for each in (points, wanted))
    there = maps.crop(points, *frame.shape)[:, :, maps.INTENSITY] > 0
    np.testing.assert_allclose(found[there], expected[there], rtol=RELATIVE)
    grows = found > 0.051
    assert grows[..., :rough][there[..., :rough]].all() and not grows[..., smooth:][there[..., smooth:]].any()


@pytest.mark.parametrize(("shape", "surfaces"), [((5, 40), 1), ((3, 50), 4), ((1, 1), 1)])
def test_collect_lists_points_by_pixel_the_strongest_first(shape, surfaces):
    rng = np.random.default_rng(5)
    depth = maps.crop(make_state(make_frame(shape, 5), surfaces, 5), *shape)[:, :, maps.DEPTH]
    depth[0, :, 0] = T                                      # −ε, rounded: the period's end is its beginning
    intensity, std = (rng.choice([0, 1, 2, 3.5], (shape[0], surfaces, shape[1])).astype(np.float32) for _ in range(2))
    intensity *= shape != (1, 1)                            # a list of none
    arguments = depth, intensity, std, rng.normal(size=(*shape, 3)).astype(np.float32), 0.0149, 12.5, T
    found, expected = (each.kernels.unpack(*each.kernels.collect(*map(each.on, arguments)))
                       for each in (CPU, ORACLE))
    assert len(found[0]) == (intensity > 0).sum() and (len(found[0]) > 50 or shape == (1, 1))
    for one, two in zip(found[:4], expected[:4]):
        assert one.dtype == two.dtype and np.array_equal(one, two)
    np.testing.assert_allclose(found[4], expected[4], rtol=1e-6)
    assert found[4].dtype == np.float32 and (found[3][0] < T).all()
