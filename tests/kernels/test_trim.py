"""Outlines: against the oracle, and what goes and stays where the photons are known."""

from dataclasses import replace

import numpy as np
import pytest

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import TRIMMED

from .frames import (
    CPU,
    FAINT,
    ORACLE,
    SHAPES,
    exact_frame,
    exact_state,
    make_frame,
    make_state,
    make_terms,
    padded,
    with_clutter,
)

BOTH = pytest.mark.parametrize("kernels", [CPU, ORACLE])
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
    frame = make_frame(shape, 1, light)
    frame = with_clutter(frame) if clutter else frame
    state = make_state(frame, surfaces, 1, light)
    maps.crop(state, *shape)[:, :, maps.DEPTH] += 40 * (np.arange(shape[1]) > 20)       # no photons speak for these
    maps.crop(state, *shape)[:, :, maps.DEPTH] %= 300
    terms = make_terms(frame, state)
    fast, slow = (kernels.changed("trim", padded(frame), state, terms, ENOUGH)[1] for kernels in (CPU, ORACLE))
    assert np.array_equal(np.delete(fast, maps.INTENSITY, axis=2), np.delete(state, maps.INTENSITY, axis=2))
    fast, slow = (maps.crop(after, *shape)[:, :, maps.INTENSITY] > 0 for after in (fast, slow))
    assert np.array_equal(fast, slow)
    before = maps.crop(state, *shape)[:, :, maps.INTENSITY] > 0
    assert shape == (3, 5) or 0 < slow.sum() < before.sum()


@BOTH
def test_points_that_no_photons_pay_for_go_and_those_behind_them_stay(kernels):
    frame = exact_frame(DEPTH, 4.0 * WALL[None], 8)
    for swollen in range(1, TRIMMED + 1):
        state = exact_state(DEPTH, 3.0 * grown(WALL, swollen)[None])
        assert np.array_equal(trimmed(kernels, frame, state)[:, 0], WALL)
    more = trimmed(kernels, frame, exact_state(DEPTH, 3.0 * grown(WALL, TRIMMED + 1)[None]))[:, 0]
    assert (more >= WALL).all() and 0 < (more & ~WALL).sum()                    # a round takes one pixel


@BOTH
def test_a_rim_that_is_darker_than_its_pool_stays_if_its_own_photons_show_it(kernels):
    inside = ~grown(~WALL, 1)
    signal = np.where(inside, 20.0, 4.0) * WALL
    frame, state = exact_frame(DEPTH, signal[None], 8), exact_state(DEPTH, 20.0 * WALL[None])
    assert np.array_equal(trimmed(kernels, frame, state)[:, 0], WALL)
    frame = exact_frame(DEPTH, np.where(inside, 20.0, 0.3)[None] * WALL, 8)
    assert np.array_equal(trimmed(kernels, frame, state)[:, 0], inside)


@BOTH
def test_borders_masked_pixels_and_other_surfaces_make_no_rim(kernels):
    dark = exact_frame(DEPTH, 0 * DEPTH, 8)
    assert trimmed(kernels, dark, exact_state(DEPTH, 0 * DEPTH + 3)).all()               # the border of the image
    state = exact_state(np.where(WALL, 100.0, 200.0)[None], 0 * DEPTH + 3)
    assert trimmed(kernels, dark, state).all()
    masked = replace(dark, exposure=WALL.astype(np.float32))
    assert np.array_equal(trimmed(kernels, masked, exact_state(DEPTH, 3.0 * WALL[None]))[:, 0], WALL)
