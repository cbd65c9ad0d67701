"""Creation, competition and removal of points against the oracle, and rules that can be seen alone."""

import numpy as np
import pytest

from srt3d_ros.kernels import maps

from .frames import (
    CPU,
    FAINT,
    GATE,
    ORACLE,
    STATES,
    T,
    assert_states_agree,
    exact_frame,
    exact_state,
    make_frame,
    make_state,
    make_terms,
    padded,
)


@pytest.mark.parametrize(("shape", "surfaces", "seed", "light", "spread"), [
    *((*case, light, spread) for case in STATES for light, spread in ((1, 0), (FAINT, 4))),
    ((9, 33), 3, 2, FAINT, 1), ((9, 33), 4, 2, 1, 1), ((3, 67), 2, 1, 0.3, 2)])
def test_birth_death(spreading, shape, surfaces, seed, light, spread):
    spreading(spread)
    frame = make_frame(shape, seed, light)
    state = make_state(frame, surfaces, seed, light)
    terms = make_terms(frame, state)
    found, after = CPU.birth_death(padded(frame), state, terms, GATE)
    assert found.dtype == np.float32
    assert_states_agree(found, ORACLE.birth_death(padded(frame), state, terms, GATE)[0], shape)
    expected = make_terms(frame, found)
    assert (np.abs(after - expected) <= 1e-5 * np.abs(expected).max(axis=(0, 1, 3), keepdims=True)).all()
    assert (after != terms).any()
    assert (found[:, :, maps.INTENSITY][padded(frame).exposure[:, None].repeat(surfaces, 1) == 0] == 0).all()


SHAPE = (7, 9)
MIDDLE = (3, slice(None), slice(None), 4)       # K surfaces and their fields, of a cropped state
ALL = np.ones((1, *SHAPE))


def chosen(frame, state, kernels=CPU) -> np.ndarray:
    """Of the pixel in the middle: depth and intensity, each [K]."""
    after, _ = kernels.birth_death(padded(frame), state, make_terms(frame, state), GATE)
    return maps.crop(after, *SHAPE)[MIDDLE][:, [maps.DEPTH, maps.INTENSITY]].T


@pytest.mark.parametrize(("background", "shown"), [(0, 20), (5, 20), (5, 0), (1, 0), (0, 0)])
def test_a_pixel_gets_its_neighbours_further_surface_if_its_own_photons_show_it(background, shown):
    depth, signal = np.concatenate([100 * ALL, 200 * ALL]), np.concatenate([30 * ALL, 20 * ALL])
    state = exact_state(depth, signal)
    maps.crop(state, *SHAPE)[MIDDLE][1, maps.INTENSITY] = 0
    signal[1, 3, 4] = shown
    found = chosen(exact_frame(depth, signal, background), state)
    np.testing.assert_allclose(found[1], [30, shown], atol=0.01)
    np.testing.assert_allclose(found[0, :1 + (shown > 0)], [100, 200][:1 + (shown > 0)], atol=0.01)


@pytest.mark.parametrize("shown", [4, 20])
def test_what_all_neighbours_show_fills_a_pixel_without_photons(shown):
    state = exact_state(100 * ALL, shown * ALL)
    maps.crop(state, *SHAPE)[MIDDLE][0, maps.INTENSITY] = 0
    dark = shown * ALL
    dark[0, 3, 4] = 0
    found = chosen(exact_frame(100 * ALL, dark, 0), state)[:, 0]
    np.testing.assert_allclose(found, [100, shown], atol=0.01)


@pytest.mark.parametrize("kernels", [CPU, ORACLE])
def test_surfaces_grow_by_one_pixel_a_time(spreading, kernels):
    lit = 2 * ALL
    lit[0, 2:5, 3:6] = 0                                        # a hole of 3 × 3 pixels without photons
    frame, state = exact_frame(100 * ALL, lit, 0), exact_state(100 * ALL, lit)
    for spread, filled in ((0, False), (1, True), (4, True)):
        spreading(spread)
        assert (chosen(frame, state, kernels)[1, 0] > 0) == filled, spread


@pytest.mark.parametrize("kernels", [CPU, ORACLE])
@pytest.mark.parametrize(("with_three", "found"), [(0, 2), (6, 2), (7, 3), (8, 3)])
def test_a_pixel_without_photons_gets_a_third_surface_if_nearly_all_neighbours_show_it(kernels, with_three, found):
    depth = np.concatenate([50 * ALL, 150 * ALL, 250 * ALL])
    intensity = np.concatenate([2 * ALL, 2 * ALL, 0 * ALL])
    around = [(i, j) for i in (2, 3, 4) for j in (3, 4, 5) if (i, j) != (3, 4)]
    for pixel in around[:with_three]:
        intensity[2][pixel] = 2
    lit = intensity.copy()
    lit[:, 3, 4] = 0
    after = chosen(exact_frame(depth, lit, 0), exact_state(depth, intensity), kernels)
    np.testing.assert_allclose(after[0, :found], [50, 150, 250][:found], atol=0.01)
    np.testing.assert_allclose(after[1], [2, 2, 2 * (found == 3)], atol=0.01)


@pytest.mark.parametrize("kernels", [CPU, ORACLE])
def test_neighbours_that_show_a_further_surface_alone_do_not_speak_against_it(kernels):
    mixed = (np.indices(SHAPE).sum(axis=0) % 2 == 0) * ALL         # of two planes, each pixel has found one so far
    depth = np.concatenate([100 * ALL, 200 * ALL])
    state = exact_state(depth, np.concatenate([(1 - mixed) / 2, mixed / 2]))
    alone = exact_state(depth, np.concatenate([ALL / 2, 0 * ALL]))
    maps.crop(alone, *SHAPE)[2, 1, maps.INTENSITY, 4] = 0.5         # one neighbour has both, all others the first
    frame = exact_frame(depth, np.concatenate([ALL / 2, ALL / 2]), 0)
    assert [np.count_nonzero(chosen(frame, before, kernels)[1]) for before in (state, alone)] == [2, 1]


@pytest.mark.parametrize("had", [0, 20])
@pytest.mark.parametrize("std", [0.3, T])
def test_a_pixel_takes_the_side_that_its_photons_show_whatever_one_neighbour_is_worth(std, had):
    depth = np.where(np.arange(9) < 5, 100.0, 200.0) * ALL
    state = exact_state(depth, 20 * ALL)
    view = maps.crop(state, *SHAPE)
    view[3, 0, [maps.DEPTH, maps.INTENSITY], 4] = 200, had
    view[2, 0, [maps.DEPTH, maps.STD], 3] = 100 if std < 1 else 250, std
    np.testing.assert_allclose(chosen(exact_frame(depth, 20 * ALL, 2), state)[:, 0], [100, 20], atol=0.01)
