"""Creation, competition and removal of points against the plain reference, and rules that can be seen alone."""

import numpy as np
import pytest

from srt3d_ros.kernels import cpu

from . import reference_propose as reference
from .frames import FAINT, GATE, STATES, assert_states_agree, make_frame, make_state

CASES = [(shape, surfaces, seed, light, spread) for shape, surfaces, seed in STATES for light in (1, FAINT)
         for spread in (0, 3)] + [((6, 40), 4, 3, light, 1) for light in (1, FAINT)]


@pytest.mark.parametrize(("shape", "surfaces", "seed", "light", "spread"), CASES)
def test_propose(shape, surfaces, seed, light, spread):
    frame = make_frame(shape, seed, light)
    state = make_state(frame, surfaces, seed, light)
    before = state.copy()
    fast = cpu.propose(frame.padded, state, 1.5, GATE, spread)
    assert np.array_equal(state, before) and fast.dtype == np.float32
    assert_states_agree(fast, reference.propose(frame.padded, state, 1.5, GATE, spread), shape)
