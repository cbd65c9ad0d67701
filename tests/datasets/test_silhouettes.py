"""Scenes before an empty sky: how far the default method lets their outlines swell."""

import numpy as np
import pytest

from srt3d_ros.core.method.memory import PooledStream
from srt3d_ros.core.sketching.design import design_for
from srt3d_ros.core.sketching.sketcher import sketch_photons
from srt3d_ros.evaluation.cases import simulated
from srt3d_ros.evaluation.run import judge


@pytest.mark.parametrize(("scene", "sbr", "ppp"), [("lattice", 0.15, 10), ("house", 1, 1)])
def test_outlines_swell_by_less_than_a_pixel_and_windows_stay_open(scene, sbr, ppp):
    case, = simulated(scene, [sbr], [ppp])
    observation = case.observe()
    frequencies = design_for(observation.frame, case.sensor).frequencies
    sketch = sketch_photons(observation.frame, case.sensor, frequencies)
    cloud = PooledStream(case.sensor, frequencies, device="cpu")(sketch)
    judged = judge(cloud, case, observation)
    assert 0 < judged["swelling_px"] < 0.7 and judged["true_detections_percent"] > 98
    shown = np.isfinite(cloud.image("depth_bins"))
    assert 0.1 < np.isfinite(observation.depth_bins[0]).mean() < 0.4
    sky = np.isnan(observation.depth_bins[0])
    inner = sky & np.roll(sky, 4, 0) & np.roll(sky, -4, 0) & np.roll(sky, 4, 1) & np.roll(sky, -4, 1)
    assert shown[inner].mean() < 0.01
