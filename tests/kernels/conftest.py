"""What is held against the oracle: the CPU's kernels, and the oracle itself in single precision, which a GPU runs."""

from importlib import import_module

import pytest
import torch

from .frames import CPU, SINGLE, Backend

torch.set_num_threads(1)        # tensors are small, and other tests run beside


@pytest.fixture(params=[CPU, SINGLE], ids=lambda backend: backend.name)
def backend(request) -> Backend:
    """What is held against the oracle."""
    return request.param


@pytest.fixture
def spreading(monkeypatch):
    """Sets by how many pixels surfaces may grow."""
    def spread(pixels: int) -> None:
        for name in ("cpu", "oracle"):
            monkeypatch.setattr(import_module(f"srt3d_ros.kernels.{name}.birth_death"), "SPREAD", pixels)
    return spread
