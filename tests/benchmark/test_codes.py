"""The coding matrices of compressive histograms, and the depth that noise-free codes of each say."""

import numpy as np
import pytest

from srt3d_ros.benchmark import codes
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketching import phase_table

NUM_BINS = 256
SENSOR = SensorModel(1, 1, NUM_BINS, 1e-10, np.exp(-0.5 * (np.arange(-8, 9) / 2.5)**2))


def test_neighbouring_cells_of_gray_codes_differ_in_one_code_round_the_period():
    matrix = codes.gray_codes(1024, 4)
    middles = np.sign(matrix[32::64])           # of the 16 cells
    assert len(np.unique(middles, axis=0)) == 16
    assert ((middles != np.roll(middles, 1, axis=0)).sum(axis=1) == 1).all()
    assert np.abs(matrix.mean(axis=0)).max() < 1e-12


def test_fourier_codes_are_the_lowest_frequencies_or_double_and_then_fill_up():
    assert codes.truncated_fourier(NUM_BINS, 6) == (1, 2, 3, 4, 5, 6)
    assert codes.gray_fourier(NUM_BINS, 10) == (1, 2, 4, 8, 16, 32, 64, 3, 5, 6)
    assert max(codes.gray_fourier(20, 99)) == 9 and len(set(codes.gray_fourier(20, 99))) == 9


@pytest.mark.parametrize("matrix, within", [
    (codes.gray_codes(NUM_BINS, 8), 0.5),
    (phase_table(codes.truncated_fourier(NUM_BINS, 8), NUM_BINS), 0.05),
    (phase_table(codes.gray_fourier(NUM_BINS, 8), NUM_BINS), 0.05),
    (codes.coarse_codes(NUM_BINS, 4), 1.0)])
def test_noise_free_codes_over_a_background_say_the_depth(matrix, within):
    depths = np.arange(NUM_BINS)
    histograms = np.full((NUM_BINS, NUM_BINS), 0.3)
    for depth in depths:
        histograms[depth, (depth + np.arange(17) - SENSOR.irf_ref) % NUM_BINS] += 20 * SENSOR.irf
    found = codes.correlate((histograms @ matrix).astype(np.float32), codes.expected_codes(matrix, SENSOR))
    error = (found - depths + NUM_BINS / 2) % NUM_BINS - NUM_BINS / 2
    assert np.abs(error).max() <= within


def test_of_a_flat_top_it_is_the_middle():
    """A pulse that is shorter than a coarse bin: every depth within the bin explains it as well."""
    sensor = SensorModel(1, 1, 64, 1e-10, np.ones(1))
    matrix = codes.coarse_codes(64, 8)
    found = codes.correlate(np.eye(8, dtype=np.float32), codes.expected_codes(matrix, sensor))
    np.testing.assert_allclose(found, 8 * np.arange(8) + 3.5)
