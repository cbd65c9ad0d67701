"""The scenes before an empty sky, and how far the default method lets their outlines swell."""

import numpy as np
import pytest

from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sketch_design import design_for
from srt3d_ros.core.sketching import sketch_photons
from srt3d_ros.datasets.silhouettes import house, lattice, silhouette_sensor
from srt3d_ros.evaluation.cases import simulated
from srt3d_ros.evaluation.run import judge


@pytest.mark.parametrize(("make", "least", "most"), [(lattice, 0.1, 0.3), (house, 0.2, 0.4)])
def test_a_plane_aslant_is_seen_through_a_shape(make, least, most):
    sensor = silhouette_sensor()
    range_m, reflectivity = make(sensor).frame(0.0)
    solid = np.isfinite(range_m)
    assert least < solid.mean() < most and (reflectivity == solid).all()
    assert np.count_nonzero(sensor.irf >= sensor.irf.max() / 2) == 8
    bins = (range_m - sensor.range_m(0)) / sensor.bin_width_m
    assert np.nanmin(bins) > 300 and np.nanmax(bins) < 700 and np.nanmax(bins) - np.nanmin(bins) > 50


@pytest.mark.parametrize(("scene", "sbr", "ppp"), [("lattice", 0.15, 10), ("house", 1, 1)])
def test_outlines_swell_by_less_than_a_pixel_and_windows_stay_open(scene, sbr, ppp):
    case, = simulated(scene, [sbr], [ppp])
    observation = case.observe()
    frequencies = design_for(observation.frame, case.sensor).frequencies
    cloud = Pooled(case.sensor, frequencies, device="cpu")(sketch_photons(observation.frame, case.sensor, frequencies))
    judged = judge(cloud, case, observation)
    assert 0 < judged["swelling_px"] < 0.7 and judged["true_detections_percent"] > 98
    shown = np.isfinite(cloud.image("depth_bins"))
    sky = np.isnan(observation.depth_bins[0])
    inner = sky & np.roll(sky, 4, 0) & np.roll(sky, -4, 0) & np.roll(sky, 4, 1) & np.roll(sky, -4, 1)
    assert shown[inner].mean() < 0.01
