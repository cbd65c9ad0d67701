"""Pile-up: what a converter counts that keeps first photons is corrected, with the shots that the background tells."""

import numpy as np
import pytest

from srt3d_ros.devices import pile_up
from tests.devices import made

SHOTS = 4e6


@pytest.mark.parametrize("photons", [1e4, 6e6])
def test_counts_become_rates(photons):
    rate = 150 + photons * made.pulse(128, np.array([30.3, 60.0]))
    counted = made.first_photons(rate, SHOTS)
    assert pile_up.corrected(counted, SHOTS) == pytest.approx(rate, rel=2e-3, abs=1)


def test_without_shots_counts_stay_and_above_the_shots_they_stay_finite():
    counted = np.arange(12, dtype=np.int32).reshape(2, 6)
    assert (pile_up.corrected(counted, np.inf) == counted).all()
    assert np.isfinite(pile_up.corrected(np.full((3, 50), 1e5), 1000.0)).all()


def test_the_background_tells_the_shots():
    counted = made.first_photons(150 + 3e6 * made.pulse(128, np.full(9, 40.0)), SHOTS)
    assert pile_up.shots(np.random.default_rng(0).poisson(counted), 10) == pytest.approx(SHOTS, rel=0.05)


@pytest.mark.parametrize("ambient, photons", [(0, 1e6), (150, 0), (150, 1e3)])
def test_a_background_that_tells_nothing(ambient, photons):
    counted = made.first_photons(ambient + photons * made.pulse(128, np.full(9, 40.0)), SHOTS)
    assert pile_up.shots(np.random.default_rng(0).poisson(counted), 10) == np.inf
