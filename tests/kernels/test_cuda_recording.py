"""What a CUDA graph records must neither wait for the GPU nor read the host's memory, and its memory must stay."""

from functools import partial

import numpy as np
import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from srt3d_ros.core.frequencies import consecutive
from srt3d_ros.core.pooled import Pooled
from srt3d_ros.core.sensor import SensorModel

# Beside kernels: memory, views of it, and what is done on the GPU; nothing that reads a number or copies to the host.
RECORDABLE = {"empty", "new_empty", "zeros", "new_zeros", "empty_like", "zeros_like", "view", "_unsafe_view", "slice",
              "select", "unsqueeze", "view_as_real", "alias", "detach", "zero_", "fill_", "copy_", "cumsum", "lt",
              "masked_fill_"}


class Watch(TorchDispatchMode):
    """Notes the names of torch's operations."""

    def __init__(self):
        super().__init__()
        self.names = set()

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        self.names.add(function.overloadpacket.__name__)
        return function(*args, **(kwargs or {}))


@pytest.mark.parametrize("clutter", [False, True])
@pytest.mark.parametrize("warm", [False, True])
@pytest.mark.parametrize("surfaces", [1, 2])
def test_a_reconstruction_can_be_recorded(cuda, monkeypatch, surfaces, warm, clutter):
    monkeypatch.setattr("srt3d_ros.core.pooled.kernels_for", lambda device: ("cuda", cuda))
    monkeypatch.setattr(type(cuda.search.__globals__["_decide"]), "run", lambda *args, **options: None)
    shape = np.linspace(1, 2, 300) / 450 if clutter else None
    sensor = SensorModel(6, 40, 300, 1e-10, np.ones(9), background_shape=shape)
    srt3d = Pooled(sensor, consecutive(5), surfaces)
    tensor = partial(torch.zeros, device=cuda.device.DEVICE)
    frame = [tensor(6, 40, dtype=torch.uint32), tensor(6, 40, 5, dtype=torch.complex64)]
    srt3d._points(warm, *frame)                             # finds memory, copies constants
    kept = {name: values.data_ptr() for name, values in srt3d._scratch._tensors.items()}

    monkeypatch.setattr("srt3d_ros.kernels.cuda.scratch.array", lambda values: pytest.fail("copies from the host"))
    with Watch() as watch:
        srt3d._points(warm, *frame)
    assert watch.names and watch.names <= RECORDABLE
    assert {name: values.data_ptr() for name, values in srt3d._scratch._tensors.items()} == kept
