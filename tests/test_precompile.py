"""What a node's frames run has been compiled by `precompile.everything`."""

import io
import re
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest

from srt3d_ros import precompile, progress
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.motion.deskew import Deskewer
from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sensor.model import GateWords
from srt3d_ros.core.sensor.projection import AngularScan
from srt3d_ros.core.sketching.frame_sketcher import FrameSketcher
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonGates
from srt3d_ros.kernels.cpu import OTHER_METHODS
from srt3d_ros.kernels.cpu.compiling import KERNELS
from srt3d_ros.messages import photon_frames, sketch_message
from srt3d_ros.reconstruction import Reconstructor
from tests.core.scenes import make_sensor, ramp, simulate, through

FREQUENCIES = (1, 2, 3, 5, 8)


def sketches(sensor) -> Iterator:
    """Of events in order and not, and of gates, as they come from messages: they cannot be written."""
    sketcher, events = FrameSketcher(sensor, FREQUENCIES), simulate(ramp(20, 24, 150, 1, 1)[None], 20, 5, sensor, 1)
    mixed = np.random.default_rng(1).permutation(events.photons)
    for seen in (events, PhotonEvents(events.pixel[mixed], events.toa[mixed])):
        raw = photon_frames.PHOTONS.encode_cdr(seen, sensor, "spad")
        sketcher.add(photon_frames.PHOTONS.decode_cdr(raw, sensor)[1])
        yield sketcher.end_frame()
    raw = photon_frames.GATES.encode_cdr(PhotonGates(np.full((2, 20, 24), 150, np.uint16)), sensor, "spad")
    seen = photon_frames.GATES.decode_cdr(raw, sensor)[1]
    assert not seen.words.flags.writeable
    sketcher.add(seen)
    yield sketcher.end_frame()


def run_as_nodes_do() -> set[str]:
    """Frames of two kinds of lenses, of one and two surfaces, moved; the kernels that ran."""
    for projection in (None, AngularScan(0.0, 0.01, 0.0, -0.01)):
        sensor = make_sensor(20, 24, gain=np.full((20, 24), 1.1), projection=projection, gates=GateWords())
        trajectory = through([(0, Pose()), (10**9, Pose())])
        for surfaces in (1, 2):
            for background in ("flat", "auto"):
                reconstruct = Reconstructor(sensor, FREQUENCIES, surfaces=surfaces, background=background,
                                            device="cpu")
                for made in sketches(sensor):
                    raw = sketch_message.encode_cdr(made, "spad")
                    seen = sketch_message.decode_cdr(raw, sensor)[1]
                    reconstruct(Deskewer(sensor, FREQUENCIES)([(10**8, seen)], trajectory, 2 * 10**8))
                    reconstruct(seen)
    return {name for name, kernel in KERNELS.items() if kernel.is_ready}


def test_what_nodes_run_has_been_compiled_ahead(repository):
    code = "from tests import test_precompile; print(*test_precompile.run_as_nodes_do())"
    run = subprocess.run([sys.executable, "-c", code], cwd=repository, capture_output=True, text=True, check=True)
    ran, ahead = set(run.stdout.split()), set(precompile.names())
    assert {"search._search_row", "sketches._residual", "move_sketch._collect"} < ran <= ahead
    assert ahead == {name for name in KERNELS if not name.startswith(OTHER_METHODS)}


@pytest.mark.parametrize(("terminal", "delay_s", "said"), [
    (True, 0, {"correlating", "reconstructing"}), (True, 60, set()), (False, 0, set())])
def test_methods_on_photons_have_a_bar_on_a_terminal_if_they_take_long(monkeypatch, terminal, delay_s, said):
    monkeypatch.setattr(progress, "DELAY_S", delay_s)
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    METHODS["rt3d"].build(make_sensor(4, 5))(simulate(np.full((4, 5), 200.0), 10, 20))
    assert set(re.findall("correlating|reconstructing", sys.stderr.getvalue())) == said
    assert bool(sys.stderr.getvalue()) == bool(said)
