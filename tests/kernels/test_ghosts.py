"""Ghosts: against the oracle, and that surfaces stay first without a gap."""

import numpy as np
import pytest

from srt3d_ros.kernels import maps

from .frames import CPU, ORACLE, SHAPES, make_frame, make_state, padded


@pytest.mark.parametrize("surfaces", [2, 3])
def test_drop_ghosts(surfaces):
    shape = SHAPES[1]
    frame = make_frame(shape, surfaces, 1)
    state = make_state(frame, surfaces, surfaces, 1)
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
