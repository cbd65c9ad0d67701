"""What the tests of kernels share: the backends of known answers, and a check of the arguments of compiled kernels."""

from importlib import import_module

import numpy as np
import pytest
import torch
from numba import typeof
from numba.core.registry import cpu_target
from numba.core.typeconv import Conversion

from srt3d_ros.kernels.cpu.compiling import Kernel

from .frames import CPU, ORACLE, Backend

torch.set_num_threads(1)        # tensors are small, and other tests run beside


@pytest.fixture(params=[CPU, ORACLE], ids=lambda backend: backend.name)
def backend(request) -> Backend:
    """What must give known answers."""
    return request.param


@pytest.fixture
def spreading(monkeypatch):
    """Sets by how many pixels surfaces may grow."""
    def spread(pixels: int) -> None:
        for name in ("cpu", "torch"):
            monkeypatch.setattr(import_module(f"srt3d_ros.kernels.{name}.method.birth_death"), "SPREAD", pixels)
    return spread


@pytest.fixture(autouse=True, scope="session")
def no_number_is_cut():
    """A kernel gets only numbers that its types hold: numba would make a 1 of 2³³ + 1 for 32 bits without a word."""
    call, convert = Kernel.__call__, cpu_target.typing_context.can_convert

    def checked(kernel, *arguments):
        for at, number in enumerate(arguments):
            how = [convert(typeof(number), signature[at]) for signature in kernel.signatures if np.isscalar(number)]
            assert not how or min(how) <= Conversion.safe, (kernel.name, at, number)
        return call(kernel, *arguments)

    Kernel.__call__ = checked
    yield
    Kernel.__call__ = call
