"""`depth_std` holds the relief that pools average out, on photons drawn here; smooth walls keep theirs."""

import numpy as np
import pytest

from tests.core.scenes import drawn

ROW, COL = np.mgrid[:80, :80]


def errors(relief: np.ndarray, signal: float, background: float, sigma: float, seed: int) -> np.ndarray:
    """Errors over their claimed standard deviations, of a slanted wall with this relief (bins)."""
    depth = 300.3 + 0.1 * COL + relief
    cloud = drawn([(depth, signal)], background, sigma, seed, 900)
    assert len(cloud) > 0.98 * depth.size
    return (cloud.depth_bins - depth[cloud.row, cloud.col]) / cloud.depth_std_bins


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def white(bins: float) -> np.ndarray:
    return bins * np.random.default_rng(2).standard_normal(ROW.shape)


# Without what the pixels' own photons say, the first four are 2 to 6. The last two follow their own photons.
@pytest.mark.parametrize(("relief", "signal", "background", "sigma"), [
    (white(2.0), 1, 0.2, 3), (white(0.5), 5, 1, 2), (white(3.0), 5, 5, 4),
    (3 * np.sin(ROW * np.pi / 3) * np.sin(COL * np.pi / 3), 5, 5, 3),
    (white(2.0), 50, 500, 3), (3 * np.sin(ROW * np.pi / 3) * np.sin(COL * np.pi / 3), 50, 50, 3)])
def test_errors_on_relief_are_as_large_as_claimed(relief, signal, background, sigma):
    assert 0.7 < rms(errors(relief, signal, background, sigma, 3)) < 1.3


def test_relief_beside_a_smooth_wall_leaves_that_as_it_is():
    half = np.where(COL < 40, 0, white(2.0))
    found = [errors(relief, 5, 5, 3, 4).reshape(-1) for relief in (half, 0 * half)]
    assert all(len(each) == half.size for each in found)
    rough, smooth = (each.reshape(half.shape) for each in found)
    assert rms(rough[:, 44:]) < 1.4 and rms(rough[:, :20]) == pytest.approx(rms(smooth[:, :20]), rel=0.1)


@pytest.mark.parametrize(("signal", "background"), [(0.5, 0.05), (1, 1), (5, 50), (50, 5)])
@pytest.mark.parametrize("step", [0, 8, 60])
def test_smooth_walls_and_steps_are_claimed_no_worse_than_they_are(signal, background, step):
    assert rms(errors(np.where(COL < 40, 0, step), signal, background, 3, 5)) > 0.7
