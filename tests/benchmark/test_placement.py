"""Where frames lie, and which device computes."""

from types import SimpleNamespace

import numpy as np
import pytest

from srt3d_ros.benchmark import frames, placement
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.sketch import Sketch
from srt3d_ros.errors import InvalidInput

SENSOR = SensorModel(rows=4, cols=4, num_bins=64, bin_width_s=1e-9, irf=np.ones(3))
SUMS, PHOTONS = np.ones((4, 4, 1), np.complex64), np.ones((4, 4), np.uint32)


class Method:
    """Builds for some devices only."""

    def __init__(self, *devices):
        self.devices = devices

    def build(self, sensor, frequencies, device):
        if device not in self.devices:
            raise InvalidInput("device", device, " or ".join(self.devices))
        return SimpleNamespace(device=device, warm_up=lambda: None)


class Tensor:
    """As much of a torch tensor on a GPU as is needed."""

    def __init__(self, array):
        self.shape, self.ndim, self.cpu = array.shape, array.ndim, lambda: self
        self.numpy = lambda: array


class Reconstructor:
    """Returns where the arrays of a sketch lie; keeps the order of submitted and awaited frames."""

    def __init__(self, device):
        self.device, self.events = device, []

    def __call__(self, sketch):
        return type(sketch.sums)

    def submit(self, sketch):
        number = len(self.events) - sum(event == "wait" for event, _ in self.events)
        self.events.append(("submit", number))
        return lambda: self.events.append(("wait", number))


def calls_of(works):
    """The function of each work, by where its frame lies."""
    return {work.facts["frame_from"]: work.call for work in works}


def test_a_method_without_cuda_stays_on_the_cpu():
    assert placement.built(Method("cpu", "cuda"), SENSOR, (1,), "cuda").device == "cuda"
    assert placement.built(Method("cpu"), SENSOR, (1,), "cuda").device == "cpu"
    with pytest.raises(InvalidInput):
        placement.built(Method("cuda"), SENSOR, (1,), "cpu")


def test_a_sketch_on_the_device_is_timed_from_there_and_from_the_host():
    there, here = Sketch((1,), Tensor(SUMS), Tensor(PHOTONS)), Sketch((1,), SUMS, PHOTONS)
    calls = calls_of(placement.reconstructions(Reconstructor("cuda"), there, "", {}))
    assert (calls["host"](), calls["device"]()) == (np.ndarray, Tensor)
    assert list(calls_of(placement.reconstructions(Reconstructor("cuda"), here, "", {}))) == ["host", "host, pipelined"]
    assert list(calls_of(placement.reconstructions(Reconstructor("cpu"), there, "", {}))) == ["host"]


def test_pipelined_frames_are_awaited_when_the_next_has_been_submitted(monkeypatch):
    monkeypatch.setattr(placement, "PIPELINED_FRAMES", 3)
    reconstructor = Reconstructor("cuda")
    *_, work = placement.reconstructions(reconstructor, Sketch((1,), SUMS, PHOTONS), "", {})
    work.call()
    assert work.frames == 3 and reconstructor.events == [
        ("submit", 0), ("submit", 1), ("wait", 0), ("submit", 2), ("wait", 1), ("wait", 2)]


def test_photons_are_sketched_as_if_just_arrived_and_from_the_device_if_they_can_be():
    events = frames.photons_of(frames.sensor_of(12), 3)
    assert events.is_sorted and "is_sorted" in vars(events)
    sketcher = SimpleNamespace(add=lambda frame: frame)
    work, = placement.sketchings(sketcher, events, "", {})
    assert work.call().pixel is events.pixel and "is_sorted" not in vars(work.call())
    sketcher.resident = lambda frame: lambda: ("device", frame)
    assert calls_of(placement.sketchings(sketcher, events, "", {}))["device"]() == ("device", events)
