"""Photons kept from the reconstruction judge clouds: exact values, the sensor's maps, standard errors."""

from dataclasses import replace

import numpy as np
import pytest

from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.evaluation import held_out

SENSOR = SensorModel(16, 24, 200, 5e-11, np.exp(-np.linspace(-2, 3, 21)**2))
DEPTH = 60 + 30 * (np.arange(24) >= 12) + np.zeros((16, 1))         # a step


def cloud_of(sensor, *layers):
    """A cloud of layers (depth, intensity), maps with NaN or 0 where there is no point."""
    depth, intensity = (np.stack([np.broadcast_to(layer[k], (sensor.rows, sensor.cols)) for layer in layers], axis=1)
                        for k in (0, 1))
    nothing = np.zeros((sensor.rows, sensor.cols), np.float32)
    return PointCloud.from_layers(sensor, depth.astype(np.float32), np.nan_to_num(intensity * np.isfinite(depth)),
                             nothing, 0)


def events(*photons):
    pixel, toa = zip(*photons)
    return PhotonEvents(np.array(pixel, np.uint32), np.array(toa, np.uint16))


def scene_photons(sensor=SENSOR, seed=1, sbr=2.0, ppp=9.0):
    """Photons of the step, and the cloud that is expected of 60 % of them."""
    simulator = Simulator(StaticScene(sensor.range_m(DEPTH)), sensor, sbr=sbr, ppp=ppp, seed=seed)
    intensity = simulator.expected(0)[1][0]
    gain = 1 if sensor.gain is None else sensor.gain
    return simulator.frame(0)[0], cloud_of(sensor, (DEPTH, 0.6 * intensity / gain))


def nats(cloud, sensor, frame, share=0.4):
    return held_out.gain(cloud, sensor, *held_out.split(frame, share), share)["held_out_nats"]


@pytest.mark.parametrize(("depths", "density"), [((4.0,), 3.0), ((4.5,), 1.5), ((13.5,), 1.5), ((4.0, 7.0), 3.0)])
def test_the_value_is_that_of_the_equation(depths, density):
    """Two pixels of ten bins: the left saw three photons, r = 3 in each of its surfaces; the right saw one."""
    sensor = SensorModel(1, 2, 10, 1e-10, [1.0])
    cloud = cloud_of(sensor, *((np.array([[depth % 10, np.nan]]), 3.0) for depth in depths))
    found = held_out.gain(cloud, sensor, events((0, 4), (0, 4), (0, 4), (1, 8)), events((0, 4), (0, 6)), 0.4)
    background, without = np.array([0.4, 0.6]), np.array([2.2, 1.8])        # windows see one pixel three times
    terms = np.log([(10 * density + 0.4) / 2.2, 0.4 / 2.2])
    expected = 0.4 / 0.6 * (3 * len(depths) + (background - without).sum())
    assert found["held_out_nats"] == pytest.approx(50 * (terms.sum() - expected), rel=1e-5)
    assert found["held_out_std"] == pytest.approx(50 * np.sqrt((terms**2).sum()), rel=1e-5)


def test_a_cloud_that_is_wrong_scores_lower():
    frame, cloud = scene_photons(ppp=30)
    right = nats(cloud, SENSOR, frame)
    for name, by in (("depth_bins", 3), ("depth_bins", -100), ("intensity", 3), ("intensity", -2), ("intensity", -99)):
        wrong = replace(cloud, **{name: np.float32(getattr(cloud, name) + by)})
        assert nats(wrong, SENSOR, frame) < right
    assert right > 100


def test_delay_and_irf_are_those_of_the_pixel():
    frame, cloud = scene_photons()
    plain = nats(cloud, SENSOR, frame)
    delay = np.arange(SENSOR.pixels).reshape(16, 24) % 7
    late = PhotonEvents(frame.pixel, ((frame.toa + delay.ravel()[frame.pixel]) % 200).astype(np.uint16))
    delayed = SENSOR.replace(delay_bins=delay)
    assert nats(cloud, delayed, late) == pytest.approx(plain, rel=1e-6) and nats(cloud, SENSOR, late) < plain - 10

    irf = np.zeros((SENSOR.pixels, 30))                                     # the same delay, as an IRF of each pixel
    irf[np.arange(SENSOR.pixels)[:, None], delay.reshape(-1, 1) + np.arange(21)] = SENSOR.irf
    of_pixels = SENSOR.replace(irf=irf)
    assert nats(cloud, of_pixels, late) == pytest.approx(plain, rel=1e-5)


def test_gain_scales_what_is_expected_of_a_pixel():
    frame, cloud = scene_photons()
    double, half = SENSOR.replace(gain=np.full((16, 24), 2)), replace(cloud, intensity=cloud.intensity / 2)
    assert nats(half, double, frame) == pytest.approx(nats(cloud, SENSOR, frame), rel=1e-6)


def test_masked_pixels_do_not_count():
    frame, cloud = scene_photons()
    sensor = SENSOR.replace(mask=np.arange(24) + np.zeros((16, 1)) != 5)
    apart = frame.pixel % 24 != 5
    stray = replace(frame, toa=np.where(apart, frame.toa, 17).astype(np.uint16))
    assert nats(cloud, sensor, stray) == nats(cloud, sensor, frame) != nats(cloud, SENSOR, frame)


def test_a_known_background_is_expected_where_it_lies():
    fog = np.exp(-np.arange(200) / 30)
    sensor = SENSOR.replace(background_shape=fog)
    frame, cloud = scene_photons(sensor, sbr=0.5, ppp=30)
    assert nats(cloud, sensor, frame) > 50
    moved = replace(cloud, depth_bins=np.full(len(cloud), 12, np.float32))      # into the fog
    assert nats(moved, sensor, frame) < 0
    even = SENSOR.replace(background_shape=np.ones(200))
    assert nats(cloud, even, frame) == pytest.approx(nats(cloud, SENSOR, frame), rel=1e-5)
