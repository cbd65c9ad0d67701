"""Points that come, go and turn, against the oracle, and by rules that can be seen alone."""

from dataclasses import replace

import numpy as np
import pytest

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import TRIMMED

from .frames import (
    CPU,
    FAINT,
    GATE,
    ORACLE,
    SHAPES,
    STATES,
    T,
    assert_states_agree,
    exact_frame,
    exact_state,
    make_terms,
    padded,
    setting,
    with_clutter,
)


@pytest.mark.parametrize(("shape", "surfaces", "seed", "light", "spread"), [
    *((*case, light, spread) for case in STATES for light, spread in ((1, 0), (FAINT, 4))),
    ((9, 33), 3, 2, FAINT, 1), ((9, 33), 4, 2, 1, 1), ((3, 67), 2, 1, 0.3, 2)])
def test_birth_death(spreading, shape, surfaces, seed, light, spread):
    spreading(spread)
    frame, state, terms = setting(shape, surfaces, seed, light)
    found, after = CPU.birth_death(padded(frame), state, terms, GATE)
    assert found.dtype == np.float32
    assert_states_agree(found, ORACLE.birth_death(padded(frame), state, terms, GATE)[0], shape)
    expected = make_terms(frame, found)
    assert (np.abs(after - expected) <= 1e-5 * np.abs(expected).max(axis=(0, 1, 3), keepdims=True)).all()
    assert (after != terms).any()
    assert (found[:, :, maps.INTENSITY][padded(frame).exposure[:, None].repeat(surfaces, 1) == 0] == 0).all()


SMALL = (7, 9)
MIDDLE = (3, slice(None), slice(None), 4)       # K surfaces and their fields, of a cropped state
EVERYWHERE = np.ones((1, *SMALL))


def chosen(frame, state, kernels=CPU) -> np.ndarray:
    """Of the pixel in the middle: depth and intensity, each [K]."""
    after, _ = kernels.birth_death(padded(frame), state, make_terms(frame, state), GATE)
    return maps.crop(after, *SMALL)[MIDDLE][:, [maps.DEPTH, maps.INTENSITY]].T


@pytest.mark.parametrize(("background", "shown"), [(0, 20), (5, 20), (5, 0), (1, 0), (0, 0)])
def test_a_pixel_gets_its_neighbours_further_surface_if_its_own_photons_show_it(background, shown):
    depth, signal = (np.concatenate([near * EVERYWHERE, far * EVERYWHERE]) for near, far in ((100, 200), (30, 20)))
    state = exact_state(depth, signal)
    maps.crop(state, *SMALL)[MIDDLE][1, maps.INTENSITY] = 0
    signal[1, 3, 4] = shown
    found = chosen(exact_frame(depth, signal, background), state)
    np.testing.assert_allclose(found[1], [30, shown], atol=0.01)
    np.testing.assert_allclose(found[0, :1 + (shown > 0)], [100, 200][:1 + (shown > 0)], atol=0.01)


@pytest.mark.parametrize("shown", [4, 20])
def test_what_all_neighbours_show_fills_a_pixel_without_photons(shown):
    state = exact_state(100 * EVERYWHERE, shown * EVERYWHERE)
    maps.crop(state, *SMALL)[MIDDLE][0, maps.INTENSITY] = 0
    dark = shown * EVERYWHERE
    dark[0, 3, 4] = 0
    found = chosen(exact_frame(100 * EVERYWHERE, dark, 0), state)[:, 0]
    np.testing.assert_allclose(found, [100, shown], atol=0.01)


def test_surfaces_grow_by_one_pixel_a_time(spreading, backend):
    lit = 2 * EVERYWHERE
    lit[0, 2:5, 3:6] = 0                                        # a hole of 3 × 3 pixels without photons
    frame, state = exact_frame(100 * EVERYWHERE, lit, 0), exact_state(100 * EVERYWHERE, lit)
    for spread, filled in ((0, False), (1, True), (4, True)):
        spreading(spread)
        assert (chosen(frame, state, backend)[1, 0] > 0) == filled, spread


@pytest.mark.parametrize(("with_three", "found"), [(0, 2), (6, 2), (7, 3), (8, 3)])
def test_a_pixel_without_photons_gets_a_third_surface_if_nearly_all_neighbours_show_it(backend, with_three, found):
    depth = np.concatenate([50 * EVERYWHERE, 150 * EVERYWHERE, 250 * EVERYWHERE])
    intensity = np.concatenate([2 * EVERYWHERE, 2 * EVERYWHERE, 0 * EVERYWHERE])
    around = [(i, j) for i in (2, 3, 4) for j in (3, 4, 5) if (i, j) != (3, 4)]
    for pixel in around[:with_three]:
        intensity[2][pixel] = 2
    lit = intensity.copy()
    lit[:, 3, 4] = 0
    after = chosen(exact_frame(depth, lit, 0), exact_state(depth, intensity), backend)
    np.testing.assert_allclose(after[0, :found], [50, 150, 250][:found], atol=0.01)
    np.testing.assert_allclose(after[1], [2, 2, 2 * (found == 3)], atol=0.01)


def test_neighbours_that_show_a_further_surface_alone_do_not_oppose_it(backend):
    mixed = (np.indices(SMALL).sum(axis=0) % 2 == 0) * EVERYWHERE      # each pixel has found one of two
    depth = np.concatenate([100 * EVERYWHERE, 200 * EVERYWHERE])
    state = exact_state(depth, np.concatenate([(1 - mixed) / 2, mixed / 2]))
    alone = exact_state(depth, np.concatenate([EVERYWHERE / 2, 0 * EVERYWHERE]))
    maps.crop(alone, *SMALL)[2, 1, maps.INTENSITY, 4] = 0.5         # one neighbour has both, all others the first
    frame = exact_frame(depth, np.concatenate([EVERYWHERE / 2, EVERYWHERE / 2]), 0)
    assert [np.count_nonzero(chosen(frame, before, backend)[1]) for before in (state, alone)] == [2, 1]


@pytest.mark.parametrize("had", [0, 20])
@pytest.mark.parametrize("std", [0.3, T])
def test_a_pixel_takes_the_side_that_its_photons_show_whatever_one_neighbour_is_worth(std, had):
    depth = np.where(np.arange(9) < 5, 100.0, 200.0) * EVERYWHERE
    state = exact_state(depth, 20 * EVERYWHERE)
    view = maps.crop(state, *SMALL)
    view[3, 0, [maps.DEPTH, maps.INTENSITY], 4] = 200, had
    view[2, 0, [maps.DEPTH, maps.STD], 3] = 100 if std < 1 else 250, std
    np.testing.assert_allclose(chosen(exact_frame(depth, 20 * EVERYWHERE, 2), state)[:, 0], [100, 20], atol=0.01)


def test_points_stay_near_one_that_is_sure(backend):
    lit = np.full((1, 40, 50), 2.0)
    frame, state = exact_frame(50 * lit, lit, 0), exact_state(50 * lit, lit)
    view = maps.crop(state, 40, 50)
    view[:, :, maps.SCORE] = 4.9
    view[5, 0, maps.SCORE, 7] = 5.1
    after = maps.crop(backend.changed("drop_blobs", padded(frame), state, 5.0)[1], 40, 50)
    expected = np.zeros((40, 50), bool)
    expected[:5 + 15, :7 + 15] = True           # within 1.5 · 9 pixels, rounded up
    np.testing.assert_array_equal(after[:, 0, maps.INTENSITY] > 0, expected)


@pytest.mark.parametrize("surfaces", [2, 3])
def test_drop_ghosts(surfaces):
    shape = SHAPES[1]
    frame, state, _ = setting(shape, surfaces, surfaces)
    view = maps.crop(state, *shape)
    view[:, 1, maps.INTENSITY] *= np.geomspace(0.01, 100, shape[1]).astype(np.float32)      # in turn, each is the ghost
    view[:, :, maps.INTENSITY] *= np.cumprod(view[:, :, maps.INTENSITY] > 0, axis=1)        # without gaps
    before = (view[:, :, maps.INTENSITY] > 0).sum(axis=1)
    fast, slow = (maps.crop(kernels.changed("drop_ghosts", padded(frame), state)[1], *shape)
                  for kernels in (CPU, ORACLE))
    there = slow[:, :, maps.INTENSITY] > 0
    np.testing.assert_array_equal(fast[:, :, maps.INTENSITY] > 0, there)
    np.testing.assert_allclose(np.where(there, fast[:, :, maps.DEPTH], 0), np.where(there, slow[:, :, maps.DEPTH], 0))
    number = there.sum(axis=1)
    assert 0 < (number < before).sum() < (before > 1).sum()
    np.testing.assert_array_equal(there, np.arange(surfaces)[:, None] < number[:, None])


def turned(backend, frame, state: np.ndarray) -> np.ndarray:
    """Slopes of first surfaces, [2, rows, cols], after `turn_planes`; it changes nothing else."""
    _, after = backend.changed("turn_planes", padded(frame), state)
    slopes = [maps.SLOPE_COL, maps.SLOPE_ROW]
    new = after[:, 0, slopes]
    after[:, 0, slopes] = state[:, 0, slopes]
    np.testing.assert_array_equal(after, state)
    return maps.crop(new, *frame.shape).swapaxes(0, 1)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("surfaces", [1, 2])
@pytest.mark.parametrize("seed", [0, 1])
def test_planes_turn_as_the_oracle_turns_them(shape, surfaces, seed):
    frame, state, _ = setting(shape, surfaces, seed)
    own = maps.crop(state[:, 0, [maps.SLOPE_COL, maps.SLOPE_ROW]], *shape).swapaxes(0, 1)
    found, expected = turned(CPU, frame, state), turned(ORACLE, frame, state)
    assert (abs(expected - own) > 0.1).any()
    assert (abs(found - expected) > 1e-4).mean() < 0.01         # rounding may decide between planes


def test_planes_turn_to_a_slope_but_not_across_an_edge(backend):
    col = np.mgrid[:12, :32][1]
    delta = exact_frame(np.zeros((1, 12, 32)), np.ones((1, 12, 32)), 0).resolution_bins
    slope = np.round(1.4 * delta)
    depth = np.where(col < 20, 3 + slope * col, 3 + 20 * slope + 5 * delta)[None] % 300
    there = np.ones_like(depth)
    there[0, 6, 10] = 0
    slope_col, slope_row = turned(backend, exact_frame(depth, 20 * there, 0), exact_state(depth, 20 * there))
    assert abs(slope_row).max() < 1e-3
    np.testing.assert_allclose(np.delete(slope_col[:, :16], 10, axis=1), slope, atol=1e-3)
    assert abs(slope_col[:, 22:]).max() < 1e-3 and slope_col[6, 10] == 0


ENOUGH = 2.3
SHAPE = (31, 40)
WALL = np.zeros(SHAPE, bool)
WALL[11:20, 13:27] = True
DEPTH = np.full((1, *SHAPE), 100.0)


def trimmed(kernels, frame, state) -> np.ndarray:
    """Where there are points afterwards, bool [rows, K, cols]."""
    after = kernels.changed("trim", padded(frame), state, make_terms(frame, state), ENOUGH)[1]
    return maps.crop(after, *frame.shape)[:, :, maps.INTENSITY] > 0


def grown(there: np.ndarray, pixels: int) -> np.ndarray:
    """There, and `pixels` around, along rows, columns and diagonals."""
    size = 2 * pixels + 1
    return np.lib.stride_tricks.sliding_window_view(np.pad(there, pixels), (size, size)).any(axis=(2, 3))


@pytest.mark.parametrize(("shape", "surfaces", "light", "clutter"), [
    (SHAPES[1], 1, FAINT, False), (SHAPES[0], 1, 1, False), (SHAPES[1], 2, FAINT, False), (SHAPES[0], 3, FAINT, True),
    ((3, 5), 1, 1, False)])
def test_trim(shape, surfaces, light, clutter):
    frame, state, _ = setting(shape, surfaces, 1, light)
    frame = with_clutter(frame) if clutter else frame
    maps.crop(state, *shape)[:, :, maps.DEPTH] += 40 * (np.arange(shape[1]) > 20)       # no photons speak for these
    maps.crop(state, *shape)[:, :, maps.DEPTH] %= 300
    terms = make_terms(frame, state)
    fast, slow = (kernels.changed("trim", padded(frame), state, terms, ENOUGH)[1] for kernels in (CPU, ORACLE))
    assert np.array_equal(np.delete(fast, maps.INTENSITY, axis=2), np.delete(state, maps.INTENSITY, axis=2))
    fast, slow = (maps.crop(after, *shape)[:, :, maps.INTENSITY] > 0 for after in (fast, slow))
    assert np.array_equal(fast, slow)
    before = maps.crop(state, *shape)[:, :, maps.INTENSITY] > 0
    assert shape == (3, 5) or 0 < slow.sum() < before.sum()


def test_points_that_no_photons_pay_for_go_and_those_behind_them_stay(backend):
    frame = exact_frame(DEPTH, 4.0 * WALL[None], 8)
    for swollen in range(1, TRIMMED + 1):
        state = exact_state(DEPTH, 3.0 * grown(WALL, swollen)[None])
        assert np.array_equal(trimmed(backend, frame, state)[:, 0], WALL)
    more = trimmed(backend, frame, exact_state(DEPTH, 3.0 * grown(WALL, TRIMMED + 1)[None]))[:, 0]
    assert (more >= WALL).all() and 0 < (more & ~WALL).sum()                    # a round takes one pixel


def test_rims_go_or_stay_by_their_own_photons_and_borders_are_none(backend):
    inside = ~grown(~WALL, 1)
    signal = np.where(inside, 20.0, 4.0) * WALL
    frame, state = exact_frame(DEPTH, signal[None], 8), exact_state(DEPTH, 20.0 * WALL[None])
    assert np.array_equal(trimmed(backend, frame, state)[:, 0], WALL)
    frame = exact_frame(DEPTH, np.where(inside, 20.0, 0.3)[None] * WALL, 8)
    assert np.array_equal(trimmed(backend, frame, state)[:, 0], inside)
    dark = exact_frame(DEPTH, 0 * DEPTH, 8)
    assert trimmed(backend, dark, exact_state(DEPTH, 0 * DEPTH + 3)).all()               # the border of the image
    state = exact_state(np.where(WALL, 100.0, 200.0)[None], 0 * DEPTH + 3)
    assert trimmed(backend, dark, state).all()
    masked = replace(dark, exposure=WALL.astype(np.float32))
    assert np.array_equal(trimmed(backend, masked, exact_state(DEPTH, 3.0 * WALL[None]))[:, 0], WALL)
