"""The CUDA kernels `log_likelihood_ratio` and `birth_death` against the float64 reference and the CPU kernels."""

from importlib import import_module

import numpy as np
import pytest

from srt3d_ros.kernels import maps

from .frames import FAINT, GATE, assert_states_agree, exact_frame, exact_state, make_frame, make_state, make_terms
from .on_device import frame_on, others


@pytest.fixture
def large_programs(cuda, monkeypatch):
    """A whole list of pixels a program, which the interpreter runs in the time of a few of them."""
    monkeypatch.setattr(import_module("srt3d_ros.kernels.cuda.birth_death"), "PER_THREAD", 1 << 10)


@pytest.mark.parametrize(("shape", "surfaces", "light"), [((3, 40), 1, 1), ((4, 33), 1, FAINT), ((3, 33), 2, FAINT),
                                                          ((2, 5), 4, 1)])
def test_log_likelihood_ratio(cuda, shape, surfaces, light):
    frame = make_frame(shape, 1, light)
    state = make_state(frame, surfaces, 1, light)
    terms = make_terms(frame, state)
    given = frame_on(cuda, frame.padded), cuda.array(state), cuda.array(terms)
    found = cuda.numpy(cuda.log_likelihood_ratio(*given))
    for other in others():
        expected = other.log_likelihood_ratio(frame.padded, state, terms)
        np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())
    assert (found > 1).any() and (found < -0.5).any()
    assert (found[state[:, :, maps.INTENSITY] == 0] == 0).all()


@pytest.fixture
def spreading(cuda, monkeypatch):
    """Sets by how many pixels surfaces may grow."""
    def spread(pixels: int) -> None:
        for kernels in (cuda, *others()):
            monkeypatch.setattr(import_module(f"{kernels.__name__}.birth_death"), "SPREAD", pixels)
    return spread


def check(cuda, shape, surfaces, light):
    frame = make_frame(shape, 1, light)
    state = make_state(frame, surfaces, 1, light)
    given, terms = cuda.array(state), make_terms(frame, state)
    after = cuda.birth_death(frame_on(cuda, frame.padded), given, cuda.array(terms), GATE)
    found = cuda.numpy(after)
    assert np.array_equal(cuda.numpy(given), state)
    for other in others():
        assert_states_agree(found, other.birth_death(frame.padded, state, terms, GATE), shape)
    margins = np.ones(state.shape, bool)
    maps.crop(margins, shape[0], found.shape[3] - 2 * maps.MARGIN)[:] = False
    assert (found[margins] == 0).all()


def test_birth_death(cuda, spreading):
    spreading(0)
    check(cuda, (3, 45), surfaces=1, light=1)


@pytest.mark.parametrize(("shape", "surfaces", "light", "spread"), [((5, 33), 1, FAINT, 4), ((3, 33), 2, 1, 2),
                                                                    ((3, 33), 3, 1, 0)])
def test_birth_death_with_surfaces_to_spread(cuda, large_programs, spreading, shape, surfaces, light, spread):
    spreading(spread)
    check(cuda, shape, surfaces, light)


def test_surfaces_grow_by_one_pixel_a_time(cuda, large_programs, spreading):
    depth, lit = np.full((1, 7, 9), 100.0), np.full((1, 7, 9), 2.0)
    lit[0, 2:5, 3:6] = 0                                        # a hole of 3 × 3 pixels without photons
    frame, state = exact_frame(depth, lit, 0), exact_state(depth, lit)
    given = frame_on(cuda, frame.padded), cuda.array(state), cuda.array(make_terms(frame, state))
    for spread, filled in ((0, False), (1, True), (2, True)):
        spreading(spread)
        after = cuda.numpy(cuda.birth_death(*given, GATE))
        assert (maps.crop(after, 7, 9)[3, 0, maps.INTENSITY, 4] > 0) == filled, spread


def test_rows_longer_than_a_list_are_cut_into_several(cuda, large_programs, spreading, monkeypatch):
    spreading(1)
    monkeypatch.setattr(import_module("srt3d_ros.kernels.cuda.birth_death"), "LONGEST_LIST", 32)
    check(cuda, (3, 45), surfaces=1, light=FAINT)


def test_what_is_settled_stays(cuda):
    depth, lit = np.full((1, 3, 5), 100.0), np.full((1, 3, 5), 20.0)
    frame, state = exact_frame(depth, lit, 2), exact_state(depth, lit)
    given = frame_on(cuda, frame.padded), cuda.array(state), cuda.array(make_terms(frame, state))
    assert np.array_equal(cuda.numpy(cuda.birth_death(*given, GATE)), state)
