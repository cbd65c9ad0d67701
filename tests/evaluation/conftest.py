"""Small observations to evaluate methods on."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.datasets import photon_file
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator

SENSOR = SensorModel(12, 20, 300, 5e-11, np.exp(-np.linspace(-2, 3, 21)**2), toa_offset_bins=1_000)


@pytest.fixture(scope="session")
def layers(tmp_path_factory):
    """Path of a photon file of two layers at 80 and 200 bins."""
    path = tmp_path_factory.mktemp("photons") / "layers.npz"
    depth = np.stack([np.full((12, 20), 80.0), np.full((12, 20), 200.0)])
    events, truth = Simulator(StaticScene(SENSOR.range_m(depth)), SENSOR, sbr=10, ppp=60).frame(0)
    photon_file.save(path, SENSOR, events, truth)
    return path
