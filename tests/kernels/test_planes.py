"""Planes of the start: `turn_planes`."""

import numpy as np
import pytest

from srt3d_ros.kernels import maps
from tests.kernels.frames import CPU, ORACLE, SHAPES, exact_frame, exact_state, make_frame, make_state, padded


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
    frame, state = make_frame(shape, seed), make_state(make_frame(shape, seed), surfaces, seed)
    own = maps.crop(state[:, 0, [maps.SLOPE_COL, maps.SLOPE_ROW]], *shape).swapaxes(0, 1)
    found, expected = turned(CPU, frame, state), turned(ORACLE, frame, state)
    assert (abs(expected - own) > 0.1).any()
    assert (abs(found - expected) > 1e-4).mean() < 0.01         # rounding may decide between planes


@pytest.mark.parametrize("backend", [CPU, ORACLE], ids=["cpu", "oracle"])
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
