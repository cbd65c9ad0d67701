"""The Python in docs/ works, and docs/photon-file.md says what the code does."""

import re

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photons import PhotonEvents
from srt3d_ros.datasets import photon_file, read
from srt3d_ros.datasets.options import SIDECAR
from srt3d_ros.datasets.readers.mat_layouts import LAYOUTS
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator


def test_the_snippet_writes_a_photon_file(repository, tmp_path, monkeypatch):
    text = (repository / "docs" / "photon-file.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    exec(re.search(r"```python\n(.*?)```", text, re.DOTALL)[1], {})
    photons = read("photons.npz")
    assert photons.frame.photons == 32 * 32 * 20 and photons.sensor.irf_ref == 1
    assert (photons.reference_depth_bins == 60).all()
    assert np.bincount(photons.frame.toa).argmax() == 60


def test_every_array_option_and_layout_is_described(repository):
    text = (repository / "docs" / "photon-file.md").read_text(encoding="utf-8")
    for name in (*photon_file.KNOWN, *SIDECAR, *(layout.variable for layout in LAYOUTS)):
        assert f"`{name}`" in text or re.fullmatch(r"ref_depth_bins_[3-8]", name), name


def test_the_calibration_finds_what_the_sensor_is(repository, tmp_path, monkeypatch):
    rng = np.random.default_rng(0)
    plain = SensorModel(24, 32, 600, 50e-12, np.exp(-0.5 * (np.arange(-9, 10) / 2.5)**2))
    true = plain.replace(gain=rng.uniform(0.6, 1.4, (24, 32)), delay_bins=rng.uniform(-8, 8, (24, 32)),
                         background_shape=np.exp(-np.arange(600) / 100) + 0.1)
    wall = StaticScene(plain.range_m((2.25 / plain.rays[..., 2]) / plain.bin_width_m))
    hot = np.repeat(rng.choice(plain.pixels, 7, replace=False), 4000).astype(np.uint32)
    monkeypatch.chdir(tmp_path)
    for name, sbr, ppp in (("dark", 1e-9, 20), ("lit", 1e-9, 2000), ("wall", 5, 400)):
        events = Simulator(wall, true, sbr=sbr, ppp=ppp).frame(0)[0]
        if name == "dark":
            events = PhotonEvents(np.append(events.pixel, hot), np.append(events.toa, hot % 600).astype(np.uint16))
        photon_file.save(f"{name}.npz", plain, events)
    text = (repository / "docs" / "calibration.md").read_text(encoding="utf-8")
    exec(re.search(r"```python\n(.*?)```", text, re.DOTALL)[1], {})
    found = read("calibrated.npz").sensor
    used = found.mask
    assert np.flatnonzero(~used).tolist() == np.unique(hot).tolist()
    gain, late = found.gain[used] / true.gain[used], (found.delay_bins - true.delay_bins)[used]
    assert (gain / gain.mean()).std() < 0.04 and np.abs(late).mean() < 0.3
    assert np.abs(np.cumsum(found.background_shape) - np.cumsum(true.background_shape)).max() < 0.03
