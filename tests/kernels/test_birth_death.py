"""Creation, competition and removal of points against the oracle, and rules that can be seen alone."""

import numpy as np
import pytest

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import DEAD_VOTES, EMPTY_SHARE, LIKENESS, VOTE

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
    padded,
)


@pytest.mark.parametrize(("shape", "surfaces", "seed", "light", "spread"), [
    *((*case, light, spread) for case in STATES for light, spread in ((1, 0), (FAINT, 4))),
    ((9, 33), 3, 2, FAINT, 1), ((9, 33), 4, 2, 1, 1), ((3, 67), 2, 1, 0.3, 2)])
def test_birth_death(backend, spreading, shape, surfaces, seed, light, spread):
    spreading(spread)
    frame = make_frame(shape, seed, light)
    state = make_state(frame, surfaces, seed, light)
    found = backend.birth_death(padded(frame), state, GATE)
    assert found.dtype == np.float32
    assert_states_agree(found, ORACLE.birth_death(padded(frame), state, GATE), shape)
    assert (found[:, :, maps.INTENSITY][padded(frame).exposure[:, None].repeat(surfaces, 1) == 0] == 0).all()


SHAPE = (7, 9)
MIDDLE = (3, slice(None), slice(None), 4)       # K surfaces and their fields, of a cropped state
ALL = np.ones((1, *SHAPE))


def chosen(frame, state, kernels=CPU) -> np.ndarray:
    """Of the pixel in the middle: depth and intensity, each [K]."""
    after = kernels.birth_death(padded(frame), state, GATE)
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
    lit = 1 * ALL
    lit[0, 2:5, 3:6] = 0                                        # a hole of 3 × 3 pixels without photons
    frame, state = exact_frame(100 * ALL, lit, 0), exact_state(100 * ALL, lit)
    for spread, filled in ((0, False), (1, True), (4, True)):               # its corners first, then the middle
        spreading(spread)
        assert (chosen(frame, state, kernels)[1, 0] > 0) == filled, spread


NEAR = [(i, j) for i in (2, 3, 4) for j in (3, 4, 5) if (i, j) != (3, 4)]


@pytest.mark.parametrize("known", [0, 2])
def test_neighbours_vote_for_a_further_surface_or_against_it(known):
    depth, shown = np.concatenate([50 * ALL, 150 * ALL, 250 * ALL])[:known + 1], []
    for voting in range(9):
        intensity = np.concatenate([2 * ALL] * known + [0 * ALL])
        for pixel in NEAR[:voting]:
            intensity[known][pixel] = 2
        lit = intensity.copy()
        lit[:, 3, 4] = 0                                        # the pixel itself has no photons
        votes = VOTE * (voting - (1 if known else EMPTY_SHARE) * (8 - voting))
        found = chosen(exact_frame(depth, lit, 0), exact_state(depth, intensity))[1, known] > 0
        assert found == (votes > min(2 / LIKENESS**(1 + (known > 0)), DEAD_VOTES * VOTE)), voting
        shown.append(found)
    assert set(shown) == {False, True}


@pytest.mark.parametrize("kernels", [CPU, ORACLE])
@pytest.mark.parametrize("photons", [0, 1])
def test_a_straight_outline_moves_where_photons_say_so(spreading, photons, kernels):
    spreading(4)
    lit = np.where(np.arange(9) < 4, 20.0, 0) * ALL             # a wall that ends before the pixel in the middle
    state, seen = exact_state(100 * ALL, lit), lit.copy()
    seen[0, :, 4] = photons * 20
    assert (chosen(exact_frame(100 * ALL, seen, 1), state, kernels)[1, 0] > 0) == (photons > 0)


@pytest.mark.parametrize("had", [0, 20])
@pytest.mark.parametrize("std", [0.3, T])
def test_a_pixel_takes_the_side_that_its_photons_show_whatever_one_neighbour_is_worth(std, had):
    depth = np.where(np.arange(9) < 5, 100.0, 200.0) * ALL
    state = exact_state(depth, 20 * ALL)
    view = maps.crop(state, *SHAPE)
    view[3, 0, [maps.DEPTH, maps.INTENSITY], 4] = 200, had
    view[2, 0, [maps.DEPTH, maps.STD], 3] = 100 if std < 1 else 250, std
    np.testing.assert_allclose(chosen(exact_frame(depth, 20 * ALL, 2), state)[:, 0], [100, 20], atol=0.01)
