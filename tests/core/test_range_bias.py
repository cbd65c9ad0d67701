"""A flat surface is neither too near nor too far, whatever the shape of the IRF and the surface's place in its bin."""

import numpy as np
import pytest
from scipy.stats import exponnorm

from srt3d_ros.core.frequencies import choose
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.datasets.scene import StaticScene
from srt3d_ros.datasets.simulator import Simulator

SIDE, PPP = 32, 50
TAILED = np.diff(exponnorm.cdf(np.arange(-8, 40) - 0.5, K=4))       # an exponential tail of 4 bins
IRFS = {"least driver": [0.1, 0.8, 1, 0.6, 0.2], "slow decay": TAILED, "slow rise": TAILED[::-1]}


def best_depth(toa: np.ndarray, irf: np.ndarray, ref: int, frequencies, num_bins: int, near: float) -> float:
    """The depth at which the data term ‖n z − r ĥ exp(i ω t)‖² of all photons together is least, in float64."""
    omega = 2 * np.pi * np.array(frequencies) / num_bins
    response = np.exp(1j * np.outer(omega, np.arange(len(irf)) - ref)) @ irf
    total = np.exp(1j * np.outer(omega, np.arange(num_bins))) @ np.bincount(toa, minlength=num_bins)
    for _ in range(8):                                              # Newton's steps
        along = np.conj(response) * total * np.exp(-1j * omega * near)
        near += (omega * along.imag).sum() / (omega**2 * along.real).sum()
    return near


@pytest.mark.parametrize("irf", IRFS.values(), ids=IRFS)
def test_the_mean_depth_of_a_flat_surface_is_that_of_all_its_photons_together(irf):
    sensor = SensorModel(SIDE, SIDE, 300, 1e-10, irf)
    frequencies = choose("auto", sensor, 10)
    method, off, true_off = Pooled(sensor, frequencies, device="cpu"), [], []
    for k, depth in enumerate(150 + np.arange(8) / 8):
        scene = StaticScene(np.full((SIDE, SIDE), float(sensor.range_m(depth))))
        frame, _ = Simulator(scene, sensor, sbr=np.inf, ppp=PPP, seed=k).frame(0)
        cloud = method(sketch_photons(frame, sensor, frequencies))
        assert len(cloud) == sensor.pixels
        own = best_depth(frame.toa, sensor.irf.astype(float), sensor.irf_ref, frequencies, sensor.num_bins, depth)
        off.append(cloud.depth_bins.mean(dtype=float) - own)
        true_off.append(own - depth)
    assert abs(np.mean(off)) < 0.01                                 # bins; they were 0.003 at most
    assert abs(np.mean(true_off)) < 0.01                            # two standard deviations
