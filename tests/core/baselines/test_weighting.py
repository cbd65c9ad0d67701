"""The weighting of the sketched data term against sums over all bins."""

import numpy as np
import pytest

from srt3d_ros.core.frequencies import angular_frequencies, irf_spectrum
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.weighting import LEVELS, weighted_steps
from srt3d_ros.errors import InvalidInput

T = 128
IRF = np.exp(-np.linspace(-2, 3, 21)**2) + 0.2 * np.exp(-np.linspace(-2, 3, 21).clip(0))        # a peak and a tail
SENSOR = SensorModel(2, 2, T, 1e-10, IRF)
FREQUENCIES = (1, 2, 3, 5, 9)


def covariance(share: float) -> np.ndarray:
    """Of conj(ĥ) exp(i ω x), real parts then imaginary ones, for x of a surface at 0 over a uniform background."""
    density = np.full(T, (1 - share) / T)
    np.add.at(density, (np.arange(len(SENSOR.irf)) - SENSOR.irf_ref) % T, share * SENSOR.irf.astype(float))
    phases = np.exp(1j * np.outer(np.arange(T), angular_frequencies(FREQUENCIES, T)))
    phases = phases * np.conj(irf_spectrum(SENSOR, FREQUENCIES))
    parts = np.concatenate([phases.real, phases.imag], axis=1)
    mean = density @ parts
    return (density[:, None] * parts).T @ parts - np.outer(mean, mean)


def derivatives() -> np.ndarray:
    """Of the expected sketch of one signal photon, in depth and in its number."""
    energy = np.abs(irf_spectrum(SENSOR, FREQUENCIES))**2
    zero = np.zeros_like(energy)
    return np.stack([np.r_[zero, angular_frequencies(FREQUENCIES, T) * energy], np.r_[energy, zero]], axis=1)


@pytest.mark.parametrize("weighting", ["identity", "precision"])
def test_steps_undo_small_errors_exactly(weighting):
    table = weighted_steps(SENSOR, FREQUENCIES, weighting).table
    for steps in table:
        np.testing.assert_allclose(steps.reshape(2, -1) @ derivatives(), np.eye(2), atol=1e-4)


@pytest.mark.parametrize("level", [6, 32, 60])
def test_precision_is_the_inverse_covariance_of_a_photons_sketch(level):
    weights = np.linalg.inv(covariance(level / (LEVELS - 1)))
    u = derivatives()
    expected = np.linalg.solve(u.T @ weights @ u, u.T @ weights)
    steps = weighted_steps(SENSOR, FREQUENCIES, "precision")
    found = steps.table[level].reshape(2, -1)
    for one, other in zip(found, expected):
        np.testing.assert_allclose(one, other, atol=0.03 * np.abs(other).max())
    assert steps.variance[level] == pytest.approx(np.linalg.inv(u.T @ weights @ u)[0, 0], rel=0.02)


@pytest.mark.parametrize("level", [0, 32, 60])
def test_identity_has_the_sandwich_variance_and_precision_less(level):
    identity, precision = (weighted_steps(SENSOR, FREQUENCIES, w) for w in ("identity", "precision"))
    steps = identity.table[0].reshape(2, -1).astype(float)
    expected = (steps @ covariance(level / (LEVELS - 1)) @ steps.T)[0, 0]
    assert identity.variance[level] == pytest.approx(expected, rel=0.02)
    assert precision.variance[level] < identity.variance[level] * 1.001


def test_an_irf_of_each_pixel_counts_by_its_mean():
    several = SENSOR.replace(irf=np.stack([SENSOR.irf] * 4))
    one, other = (weighted_steps(sensor, FREQUENCIES, "precision") for sensor in (SENSOR, several))
    np.testing.assert_allclose(other.table, one.table, rtol=1e-3, atol=1e-4 * np.abs(one.table).max())


def test_an_unknown_weighting_is_named():
    with pytest.raises(InvalidInput, match="^weighting is half: expected identity or precision$"):
        weighted_steps(SENSOR, FREQUENCIES, "half")
