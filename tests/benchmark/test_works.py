"""What is timed: a method where it can compute, and frames as if they had just arrived."""

from types import SimpleNamespace

import numpy as np
import pytest

from srt3d_ros.benchmark import frames, works
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import InvalidInput


class Method:
    """Builds for some devices only."""

    def __init__(self, *devices):
        self.devices = devices

    def build(self, sensor, frequencies, device):
        if device not in self.devices:
            raise InvalidInput("device", device, " or ".join(self.devices))
        return SimpleNamespace(device=device, warm_up=lambda: None)


def test_a_method_without_cuda_stays_on_the_cpu():
    sensor = SensorModel(rows=4, cols=4, num_bins=64, bin_width_s=1e-9, irf=np.ones(3))
    assert works.built(Method("cpu", "cuda"), sensor, (1,), "cuda").device == "cuda"
    assert works.built(Method("cpu"), sensor, (1,), "cuda").device == "cpu"
    with pytest.raises(InvalidInput):
        works.built(Method("cuda"), sensor, (1,), "cpu")


def test_photons_are_sketched_as_if_just_arrived():
    events = frames.photons_of(frames.sensor_of(12), 3)
    assert events.is_sorted and "is_sorted" in vars(events)
    work = works.sketching(SimpleNamespace(add=lambda frame: frame), events, "", {})
    assert work.call().pixel is events.pixel and "is_sorted" not in vars(work.call())
