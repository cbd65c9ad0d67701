"""What takes long shows on a terminal how far it is, and nowhere else."""

import io
import sys

import numpy as np
import pytest

from srt3d_ros.core import progress
from srt3d_ros.core.methods import METHODS
from srt3d_ros.core.photons import PhotonEvents
from srt3d_ros.core.sensor import SensorModel

SENSOR = SensorModel(4, 5, 60, 1e-10, [1, 4, 1])
PHOTONS = PhotonEvents(np.repeat(np.arange(20, dtype=np.uint32), 9), np.tile(np.uint16([20, 20, 21]), 60))


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(("method", "doing"), [("rt3d", {"correlating", "reconstructing"}), ("xcorr", {"correlating"})])
def test_methods_on_photons_have_a_bar_on_a_terminal_if_they_take_long(monkeypatch, method, doing):
    reconstruct = METHODS[method].build(SENSOR)
    said = {}
    for kind, delay_s in ((Terminal, 0.0), (Terminal, 60.0), (io.StringIO, 0.0)):
        monkeypatch.setattr(progress, "DELAY_S", delay_s)
        monkeypatch.setattr(sys, "stderr", kind())
        reconstruct(PHOTONS)
        said[kind, delay_s] = sys.stderr.getvalue()
    assert all(word in said[Terminal, 0.0] for word in doing)
    assert said[Terminal, 60.0] == said[io.StringIO, 0.0] == ""
