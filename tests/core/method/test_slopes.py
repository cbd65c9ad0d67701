"""Steep surfaces, on photons drawn here."""

import numpy as np
import pytest

from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.core.sketching.frequencies import choose_frequencies
from srt3d_ros.core.sketching.photon_frame import PhotonEvents

T, SIGMA, SIDE = 1800, 3.0, 44


# Without `turn_planes`, all fail but one.
@pytest.mark.parametrize(("slope", "fall"), [(10, 0), (12, 0), (0, 12), (9, -5), (30, 0), (35, 0)])
@pytest.mark.parametrize(("signal", "background"), [(1, 0.2), (5, 50)])
def test_a_steep_plane_is_found_where_it_is(slope, fall, signal, background):
    sensor = SensorModel(SIDE, SIDE, T, 1e-11, np.exp(-np.arange(-18, 19)**2 / (2 * SIGMA**2)))
    frequencies = choose_frequencies("auto", sensor)
    row, col = np.mgrid[:SIDE, :SIDE]
    depth = 230.3 + slope * col + fall * row
    rng = np.random.default_rng(7)
    pixel = np.repeat(np.arange(SIDE**2), rng.poisson(signal, SIDE**2))
    toa = np.rint(depth.ravel()[pixel] + SIGMA * rng.standard_normal(len(pixel))).astype(int)
    number = rng.poisson(background * SIDE**2)
    pixel, toa = np.r_[pixel, rng.integers(0, SIDE**2, number)], np.r_[toa, rng.integers(0, T, number)]
    events = PhotonEvents(pixel.astype(np.uint32), toa.astype(np.uint16))
    cloud = Pooled(sensor, frequencies)(sketch_photons(events, sensor, frequencies))
    error = abs(cloud.depth_bins - depth[cloud.row, cloud.col])
    near = error < 9 + (abs(slope) + abs(fall)) / 2
    assert near.sum() >= 0.995 * SIDE**2 and (~near).sum() <= 0.005 * SIDE**2
    assert error[near].mean() <= 0.8
