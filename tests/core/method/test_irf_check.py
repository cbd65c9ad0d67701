"""Photons near surfaces that an IRF without its tail leaves unexplained, and that an exact one does not."""

import numpy as np
import pytest

from srt3d_ros import Reconstructor, from_events
from srt3d_ros.reconstruction import ASKED

ROWS, BINS, SIGMA = 40, 1000, 2.5
CORE = np.exp(-np.arange(-18, 19)**2 / 2 / SIGMA**2)


def sketch(signal: float, background: float, tail: float, irf, second: float = 0.0, frequencies="auto", **more):
    """Of a curved wall, of whose photons the share `tail` comes 40 bins late on average."""
    rng, (row, col) = np.random.default_rng(0), np.mgrid[:ROWS, :ROWS]
    pixel, stray = (np.repeat(np.arange(ROWS**2), rng.poisson(light, ROWS**2)) for light in (signal, background))
    depth = 400 + 0.4 * row + 8 * np.sin(col / 7)
    late = rng.exponential(40, len(pixel)) * (rng.random(len(pixel)) < tail) + 120 * (rng.random(len(pixel)) < second)
    toa = np.rint(np.r_[depth.ravel()[pixel] + rng.normal(0, SIGMA, len(pixel)) + late,
                        rng.integers(0, BINS, len(stray))]).astype(int) % BINS
    pixel = np.r_[pixel, stray]
    return from_events(pixel // ROWS, pixel % ROWS, toa, shape=(ROWS, ROWS), num_bins=BINS, bin_width_s=1e-11,
                       fov_deg=15, irf=irf, **more).sketch(frequencies=frequencies)


def notes(*light, surfaces: int = 1, **more):
    return on_the_irf(sketch(*light, **more).reconstruct(surfaces=surfaces, device="cpu"))


def on_the_irf(cloud):
    return [note for note in cloud.notes if "near surfaces stay unexplained" in note]


@pytest.mark.parametrize(("signal", "background"), [(2, 2), (20, 2), (20, 200)])
def test_a_tail_that_the_irf_lacks_is_said_with_its_share(signal, background):
    note, = notes(signal, background, 0.3, CORE)
    assert note.startswith(("18% ", "19% ", "20% ", "21% ")) and "the IRF lacks a tail" in note


@pytest.mark.parametrize(("signal", "background", "surfaces"), [(1, 10, 1), (2, 2, 1), (2, 2, 2), (100, 1, 1),
                                                                (20, 200, 2)])
def test_an_exact_irf_leaves_nothing(signal, background, surfaces):
    late = np.exp(-np.arange(250) / 40)
    whole = 0.7 * np.pad(CORE / CORE.sum(), (0, 250)) + 0.3 * np.convolve(CORE / CORE.sum(), np.append(late, 0)
                                                                          / late.sum())
    assert notes(signal, background, 0, CORE, surfaces=surfaces) == []
    assert notes(signal, background, 0.3, whole, surfaces=surfaces) == []


@pytest.mark.parametrize("surfaces", [1, 2])
def test_a_second_surface_is_no_tail(surfaces):
    assert notes(20, 2, 0, CORE, surfaces=surfaces, second=0.4) == []


def test_where_pile_up_is_corrected_nothing_is_said():
    assert notes(20, 2, 0.3, CORE, cycles=1000) == []


def test_an_answer_stands_for_several_frames_and_is_forgotten_with_them():
    exact = sketch(20, 2, 0, CORE)
    lacking = sketch(20, 2, 0.3, CORE, frequencies=exact.frequencies)
    reconstructor = Reconstructor(exact.sensor, exact.frequencies, device="cpu")
    assert [bool(on_the_irf(reconstructor(frame))) for frame in (lacking, *[exact] * ASKED)] == [True] * ASKED + [False]
    assert not on_the_irf(reconstructor(lacking))
    reconstructor.forget()
    assert on_the_irf(reconstructor(lacking))
