"""Where frames lie, and which device computes."""

from types import SimpleNamespace

import numpy as np
import pytest

from srt3d_ros.benchmark import placement
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import InvalidInput

SENSOR = SensorModel(rows=4, cols=4, num_bins=64, bin_width_s=1e-9, irf=np.ones(3))


class Method:
    """Builds for some devices only."""

    def __init__(self, *devices):
        self.devices = devices

    def build(self, sensor, frequencies, device):
        if device not in self.devices:
            raise InvalidInput("device", device, " or ".join(self.devices))
        return SimpleNamespace(device=device, warm_up=lambda: None)


def test_a_method_without_cuda_stays_on_the_cpu():
    assert placement.built(Method("cpu", "cuda"), SENSOR, (1,), "cuda").device == "cuda"
    assert placement.built(Method("cpu"), SENSOR, (1,), "cuda").device == "cpu"
    with pytest.raises(InvalidInput):
        placement.built(Method("cuda"), SENSOR, (1,), "cpu")


def test_what_can_be_resident_is_timed_both_ways():
    class Resident:
        def __call__(self, frame):
            return "host", frame

        def resident(self, frame):
            return lambda: ("device", frame)

    assert {place: call() for place, call in placement.reconstructions(Resident(), 7).items()} == {
        "host": ("host", 7), "device": ("device", 7)}
    assert list(placement.reconstructions(lambda frame: frame, 7)) == ["host"]


def test_a_sketcher_is_on_the_device_if_it_can_be(monkeypatch):
    class OnDevice:
        def __init__(self, sensor, frequencies, device="cpu"):
            self.device = device

    sketcher, device = placement.sketcher_on(SENSOR, (1,), "cpu")
    assert device == "cpu"
    monkeypatch.setattr(placement, "Sketcher", OnDevice)
    sketcher, device = placement.sketcher_on(SENSOR, (1,), "cuda")
    assert (sketcher.device, device) == ("cuda", "cuda")
    monkeypatch.setattr(placement, "Sketcher", lambda sensor, frequencies: "only here")
    assert placement.sketcher_on(SENSOR, (1,), "cuda") == ("only here", "cpu")
