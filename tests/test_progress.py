"""Long work shows a progress bar on a terminal, and nothing elsewhere."""

import io
import sys

import numpy as np

from srt3d_ros import progress
from srt3d_ros.core.methods import METHODS
from tests.core.scenes import make_sensor, simulate


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_methods_on_photons_have_a_bar_on_a_terminal_if_they_take_long(monkeypatch):
    reconstruct, said = METHODS["rt3d"].build(make_sensor(4, 5)), {}
    for kind, delay_s in ((Terminal, 0.0), (Terminal, 60.0), (io.StringIO, 0.0)):
        monkeypatch.setattr(progress, "DELAY_S", delay_s)
        monkeypatch.setattr(sys, "stderr", kind())
        reconstruct(simulate(np.full((4, 5), 200.0), 10, 20))
        said[kind, delay_s] = sys.stderr.getvalue()
    assert all(word in said[Terminal, 0.0] for word in ("correlating", "reconstructing"))
    assert said[Terminal, 60.0] == said[io.StringIO, 0.0] == ""
