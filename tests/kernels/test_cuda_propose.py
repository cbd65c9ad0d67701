"""The CUDA kernels `evidence` and `propose` against the float64 reference and the CPU kernels."""

from importlib import import_module

import numpy as np
import pytest

from srt3d_ros.core import layout

from .frames import FAINT, GATE, assert_states_agree, exact_frame, exact_state, make_frame, make_state
from .on_device import frame_on, others


@pytest.fixture
def large_programs(cuda, monkeypatch):
    """A whole list of pixels a program, which the interpreter runs in the time of a few of them."""
    monkeypatch.setattr(import_module("srt3d_ros.kernels.cuda.propose"), "PER_THREAD", 1 << 10)


@pytest.mark.parametrize(("shape", "surfaces", "light"), [((3, 40), 1, 1), ((4, 33), 1, FAINT), ((3, 33), 2, FAINT),
                                                          ((2, 5), 4, 1)])
def test_evidence(cuda, shape, surfaces, light):
    frame = make_frame(shape, 1, light)
    state = make_state(frame, surfaces, 1, light)
    found = cuda.numpy(cuda.evidence(frame_on(cuda, frame.padded), cuda.array(state)))
    for other in others():
        expected = other.evidence(frame.padded, state)
        np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())
    assert (found > 1).any() and (found < -0.5).any()
    assert (found[state[:, :, layout.INTENSITY] == 0] == 0).all()


def check(cuda, shape, surfaces, light, spread):
    frame = make_frame(shape, 1, light)
    state = make_state(frame, surfaces, 1, light)
    given = cuda.array(state)
    found = cuda.numpy(cuda.propose(frame_on(cuda, frame.padded), given, 1.5, GATE, spread))
    assert np.array_equal(cuda.numpy(given), state)
    for other in others():
        assert_states_agree(found, other.propose(frame.padded, state, 1.5, GATE, spread), shape)
    margins = np.ones(state.shape, bool)
    layout.crop(margins, shape[0], found.shape[3] - 2 * layout.MARGIN)[:] = False
    assert (found[margins] == 0).all()


def test_propose(cuda):
    check(cuda, (3, 45), surfaces=1, light=1, spread=0)


@pytest.mark.parametrize(("shape", "surfaces", "light", "spread"), [((5, 33), 1, FAINT, 3), ((3, 33), 2, 1, 1),
                                                                    ((3, 33), 3, 1, 0)])
def test_propose_with_surfaces_to_spread(cuda, large_programs, shape, surfaces, light, spread):
    check(cuda, shape, surfaces, light, spread)


def test_surfaces_grow_by_one_pixel_a_step(cuda, large_programs):
    depth, lit = np.full((1, 5, 7), 100.0), np.full((1, 5, 7), 20.0)
    lit[0, 1:4, 2:5] = 0                                        # a hole of 3 × 3 dead pixels
    frame, state = frame_on(cuda, exact_frame(depth, lit, 0).padded), cuda.array(exact_state(depth, lit))
    filled = [cuda.propose(frame, state, 1.5, GATE, spread) for spread in (0, 1, 2)]
    filled = [layout.crop(cuda.numpy(after), 5, 7)[2, 0, layout.INTENSITY, 3] > 0 for after in filled]
    assert filled == [False, True, True]


def test_rows_longer_than_a_list_are_cut_into_several(cuda, large_programs, monkeypatch):
    monkeypatch.setattr(import_module("srt3d_ros.kernels.cuda.propose"), "LONGEST_LIST", 32)
    check(cuda, (3, 45), surfaces=1, light=FAINT, spread=1)


def test_what_is_settled_stays_but_for_wider_windows(cuda):
    depth, lit = np.full((1, 3, 5), 100.0), np.full((1, 3, 5), 20.0)
    state = exact_state(depth, lit)
    after = cuda.numpy(cuda.propose(frame_on(cuda, exact_frame(depth, lit, 2).padded), cuda.array(state), 1.5, GATE, 2))
    view = layout.crop(state, 3, 5)
    view[:, :, layout.WINDOW] = 1.5
    assert np.array_equal(layout.crop(after, 3, 5), view)
