"""Where frames lie, and which device computes."""

from types import SimpleNamespace

import numpy as np
import pytest

from srt3d_ros.benchmark import placement
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
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


class Tensor:
    """As much of a torch tensor on a GPU as is needed."""

    def __init__(self, array):
        self.array, self.shape, self.ndim = array, array.shape, array.ndim

    def cpu(self):
        return self

    def numpy(self):
        return self.array


SUMS, PHOTONS = np.ones((4, 4, 1), np.complex64), np.ones((4, 4), np.uint32)


def test_a_sketch_on_the_device_is_timed_from_there_and_from_the_host():
    def reconstructor(sketch):
        return type(sketch.sums), type(sketch.photons)

    reconstructor.device = "cuda"
    there = Sketch((1,), Tensor(SUMS), Tensor(PHOTONS))
    calls = placement.reconstructions(reconstructor, there)
    assert {place: call() for place, call in calls.items()} == {
        "host": (np.ndarray, np.ndarray), "device": (Tensor, Tensor)}
    reconstructor.device = "cpu"
    assert list(placement.reconstructions(reconstructor, there)) == ["host"]
    reconstructor.device = "cuda"
    assert list(placement.reconstructions(reconstructor, Sketch((1,), SUMS, PHOTONS))) == ["host"]


def test_pipelined_frames_are_awaited_when_the_next_has_been_submitted(monkeypatch):
    events = []

    class Reconstructor:
        device = "cuda"

        def submit(self, sketch):
            number = sum(event[0] == "submit" for event in events)
            events.append(("submit", number))
            return lambda: events.append(("wait", number))

    monkeypatch.setitem(placement.FRAMES, placement.PIPELINED, 3)
    placement.reconstructions(Reconstructor(), Sketch((1,), SUMS, PHOTONS))[placement.PIPELINED]()
    assert events == [("submit", 0), ("submit", 1), ("wait", 0), ("submit", 2), ("wait", 1), ("wait", 2)]
    Reconstructor.device = "cpu"
    assert placement.PIPELINED not in placement.reconstructions(Reconstructor(), Sketch((1,), SUMS, PHOTONS))


def test_photons_are_sketched_from_the_device_if_they_can_be():
    sketcher = SimpleNamespace(add=lambda frame: ("host", frame))
    assert {place: call() for place, call in placement.sketchings(sketcher, 7, lambda frame: -frame).items()} == {
        "host": ("host", -7)}
    sketcher.resident = lambda frame: lambda: ("device", frame)
    assert placement.sketchings(sketcher, 7, lambda frame: -frame)["device"]() == ("device", 7)
