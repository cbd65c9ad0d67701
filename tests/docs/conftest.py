"""The files that the commands on the pages read."""

import os
import sys
from pathlib import Path

import numpy as np
import ptufile
import pytest

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.photon_frame import PhotonEvents
from srt3d_ros.datasets import photon_file
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.messages import photon_frames, sensor_message
from tests.bags import CLOUD, TEXT, write_bag
from tests.datasets.laboratory_files import pulse_cube
from tests.review.conftest import write_ball

from .pages import ROOT

RNG = np.random.default_rng(0)
PLAIN = SensorModel(24, 32, 600, 50e-12, np.exp(-0.5 * (np.arange(-9, 10) / 2.5)**2))
TRUE = PLAIN.replace(gain=RNG.uniform(0.6, 1.4, (24, 32)), delay_bins=RNG.uniform(-8, 8, (24, 32)),
                     background_shape=np.exp(-np.arange(600) / 100) + 0.1)
HOT = np.sort(RNG.choice(PLAIN.pixels, 7, replace=False))
HEAD = Simulator(ppp=5)


@pytest.fixture(scope="module")
def here(tmp_path_factory, ball) -> Path:
    """Work in a folder with config/, examples/ and files that pages read; `python` and `srt3d` are the tests' own."""
    folder = tmp_path_factory.mktemp("given")
    face = np.s_[30:60, 40:70]
    small = Simulator(StaticScene(HEAD.sensor.range_m(HEAD.frame(0)[1][0][face])), HEAD.sensor.cropped(*face), ppp=5)
    for name in ("head", "art"):
        photon_file.save(folder / f"{name}.npz", small.sensor, *small.frame(0))
    wall = StaticScene(PLAIN.range_m((2.25 / PLAIN.rays[..., 2]) / PLAIN.bin_width_m))
    for name, sbr, ppp in (("dark", 1e-9, 20), ("lit", 1e-9, 2000), ("wall", 5, 400)):
        seen, _ = Simulator(wall, TRUE, sbr=sbr, ppp=ppp).frame(0)
        if name == "dark":
            hot = np.repeat(HOT, 4000).astype(np.uint32)
            seen = PhotonEvents(np.append(seen.pixel, hot), np.append(seen.toa, hot % 600).astype(np.uint16))
        photon_file.save(folder / f"{name}.npz", PLAIN, seen)
    ptufile.imwrite(folder / "scan.ptu", pulse_cube(24, 24)[None, :, :, None], 120 * 1e-10, 1e-10)
    packet = photon_frames.PHOTONS.encode_cdr(small.frame(0)[0], small.sensor, "lidar")
    described = ("/sensor", TEXT, sensor_message.encode_cdr(small.sensor))
    write_bag(folder / "rec", [described, *[("/photons", CLOUD, packet)] * 8])
    write_ball(folder / "run.rrd", *ball)
    for name in ("config", "examples"):
        (folder / name).symlink_to(ROOT / name)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("MPLBACKEND", "Agg")
        patch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")
        yield folder
