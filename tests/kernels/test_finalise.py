"""The kernels before and after the iterations: `prepare`, `finalise`, `collect` and `unexplained`."""

import numpy as np
import pytest

from srt3d_ros.core.method.matched_frame import Matcher
from srt3d_ros.kernels import maps
from tests.core.scenes import matched_frame

from .frames import (
    CPU,
    ORACLE,
    RELATIVE,
    SHAPES,
    T,
    exact_frame,
    exact_state,
    make_frame,
    make_sensor,
    make_sketch,
    make_state,
    make_terms,
    padded,
    setting,
    with_clutter,
)


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
    frame, state, terms = setting((9, 96), surfaces, 1)
    view = maps.crop(state, *frame.shape)
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


@pytest.mark.parametrize(("shape", "surfaces", "each"), [((4, 40), 1, False), ((3, 33), 2, True), ((1, 1), 1, False)])
def test_unexplained(shape, surfaces, each):
    frame, rng = make_frame(shape, 1), np.random.default_rng(2)
    state = make_state(frame, surfaces, 1)
    rest, taken = rng.uniform(0.5, 20, (2, *shape)).astype(np.float32)
    size = (*shape, len(frame.energy)) if each else (1, 1, len(frame.energy))
    passed = (rng.normal(size=size) + 1j * rng.normal(size=size)).astype(np.complex64)
    arguments = padded(frame), state, rest, taken * (frame.exposure > 0) if each else None, passed
    found, expected = CPU.unexplained(*arguments), ORACLE.unexplained(*arguments)
    assert found.dtype == np.float32 and found.shape == (4 * len(frame.energy) + 4,)
    np.testing.assert_allclose(found, expected, atol=RELATIVE * np.abs(expected[:-1]).max(), rtol=RELATIVE)


def test_points_that_are_right_leave_nothing_but_the_background():
    x = np.mgrid[:5, :7][1]
    depth, signal = (100.0 + 3 * x)[None], np.full((1, *x.shape), 10.0)
    frame, state = exact_frame(depth, signal, 4), exact_state(depth, signal)
    m, taken = len(frame.energy), np.full(x.shape, 4.0)
    photons = signal[0] + taken
    found = ORACLE.unexplained(padded(frame), state, taken, taken, np.ones((1, 1, m), np.complex64))
    share = taken / photons
    omega = 2 * np.pi * frame.bin_frequencies
    seen = (share * signal[0] * np.exp(1j * omega[:, None, None] * depth[0])).sum(axis=(1, 2))
    assert np.abs(found[:2 * m]).max() < 1e-3
    np.testing.assert_allclose(found[2 * m:4 * m], np.concatenate([seen.real, seen.imag]), atol=1e-2)
    np.testing.assert_allclose(found[4 * m:], [(share * taken).sum()] * 2 + [(share**2 * photons).sum(), 0], atol=1e-3)


@pytest.mark.parametrize(("shape", "each"), [((3, 40), False), ((2, 5), True)])
def test_prepare_makes_the_frame_of_the_matcher_and_takes_the_background_out(backend, shape, each):
    sensor, rng = make_sensor(*shape, seed=2), np.random.default_rng(4)
    if each:        # an equaliser for each pixel
        sensor = sensor.replace(delay_bins=rng.uniform(-9, 9, shape))
    sketch = make_sketch(sensor, seed=2)
    matcher, photons = Matcher(sensor, sketch.frequencies), sketch.photons.astype(np.float32)
    wide = padded(matched_frame(sensor, sketch))
    matched, counts = backend.prepare(sketch.sums, photons, matcher.equaliser, matcher.used)
    np.testing.assert_allclose(matched, wide.matched, atol=1e-5 * np.abs(wide.matched).max())
    np.testing.assert_array_equal(counts, wide.counts)
    taken = (rng.uniform(0, 9, shape) * matcher.used).astype(np.float32)
    size = (*shape, len(sketch.frequencies)) if each else (1, 1, len(sketch.frequencies))
    passed, mean = (rng.normal(size=(*each, 2)).astype(np.float32).view(np.complex64)[..., 0]
                    for each in (size, size[2:]))
    arguments = sketch.sums, photons, matcher.equaliser, matcher.used, taken, passed, mean
    matched, counts = backend.prepare(*arguments)
    left = maps.crop(matched, *shape).swapaxes(1, 2)
    expected = sketch.sums * matcher.equaliser - taken[..., None] * passed * mean
    np.testing.assert_allclose(left, np.concatenate([expected.real, expected.imag], axis=-1), atol=1e-3)
    np.testing.assert_array_equal(maps.crop(counts, *shape), sketch.photons * matcher.used)


def test_complex_products_of_the_background_are_rounded_part_by_part_as_on_any_processor():
    """NumPy's product of complex64 has other bits where the processor has AVX2."""
    rng = np.random.default_rng(5)
    p, q, b, c = rng.normal(size=(4, 1, 1, 99)).astype(np.float32)
    sums, one = np.zeros((1, 1, 99), np.complex64), np.ones((1, 1), np.float32)
    matched, _ = CPU.prepare(sums, one, sums, one, one, p + 1j * q, (b + 1j * c)[0, 0])
    assert np.array_equal(-maps.crop(matched, 1, 1).ravel(), np.concatenate([p * b - q * c, p * c + q * b], axis=None))
