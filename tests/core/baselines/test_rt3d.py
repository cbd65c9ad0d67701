"""RT3D's likelihood: its steps reach the maximum, and its information is Fisher's."""

import numpy as np
import pytest

from srt3d_ros.core.baselines.rt3d import RT3D
from srt3d_ros.core.baselines.toa import by_pixel
from srt3d_ros.kernels import cpu
from tests.core.scenes import T, make_sensor, simulate


def test_steps_without_denoiser_reach_maximum_likelihood():
    sensor = make_sensor(3, 4)
    photons = by_pixel(simulate(np.full((3, 4), 200.0), sbr=2, ppp=60), sensor)
    data = RT3D(sensor)._likelihood(photons, ratio=0.01)
    depth, intensity = np.full((3, 1, 4), 203, np.float32), np.full((3, 1, 4), 10, np.float32)
    background = np.full((3, 4), 20 / T, np.float32)
    for _ in range(200):
        cpu.poisson(data, background, 0.25, 0.0, depth, intensity)
    t, r = np.linspace(195, 205, 201), np.linspace(10, 70, 121)
    irf = sensor.irf.astype(float)
    for p in range(12):
        toa = photons.toa[photons.starts[p]:photons.starts[p + 1]]
        place = toa - t[:, None] + sensor.irf_ref
        h = np.interp(place, np.arange(-1, len(irf) + 1), np.r_[0, irf, 0], left=0, right=0)          # [t, photons]
        likelihood = np.log(r[:, None, None] * h + 20 / T).sum(axis=2) - r[:, None]
        at_r, at_t = np.unravel_index(likelihood.argmax(), likelihood.shape)
        assert intensity.reshape(-1)[p] == pytest.approx(r[at_r], abs=1.5)
        assert depth.reshape(-1)[p] == pytest.approx(t[at_t], abs=0.8)      # h′ is smoothed over two bins
