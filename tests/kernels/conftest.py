"""The backends that are held against the reference. CUDA's device is a GPU, or Triton's interpreter on the CPU."""

import os
import sys
from dataclasses import fields, is_dataclass, replace
from importlib import import_module
from importlib.util import find_spec

import numpy as np
import pytest
import torch

from srt3d_ros.core.device import on_device

INTERPRET = "TRITON_INTERPRET"          # read when kernels are defined, which is while tests are collected, and run
interpreted = find_spec("triton") is not None and not torch.cuda.is_available()
if interpreted:
    os.environ[INTERPRET] = "1"
    from triton.runtime import interpreter

    import srt3d_ros.kernels.cuda  # noqa: F401
    # Else every sum of integers is made a second time to see whether it overflows, and without `debug` nobody looks.
    interpreter.interpreter_builder.options = interpreter.InterpreterOptions(sanitize_overflow=False)


def pytest_collection_finish():
    """Where the tests of other folders ask for a GPU, there shall be none."""
    if interpreted:
        os.environ.pop(INTERPRET, None)


@pytest.fixture(autouse=True)
def interpret(monkeypatch):
    """Interpret kernels."""
    if interpreted:
        monkeypatch.setenv(INTERPRET, "1")


@pytest.fixture(scope="session")
def cuda():
    """The CUDA kernels; skips the test where Triton is missing."""
    pytest.importorskip("triton")
    from srt3d_ros.kernels import cuda
    return cuda


class Backend:
    """The kernels of a backend, called with NumPy arrays and frames; their results are NumPy arrays."""

    def __init__(self, name: str, kernels):
        self.name, self.kernels = name, kernels

    def on(self, value):
        """The value as the kernels take it, arrays copied: kernels may change them."""
        if isinstance(value, np.ndarray):
            return self.kernels.array(value.copy())
        if is_dataclass(value):
            return replace(value, **on_device({f.name: getattr(value, f.name) for f in fields(value)}, self.kernels))
        return value

    def off(self, value):
        """A result as NumPy arrays."""
        if isinstance(value, tuple):
            return tuple(map(self.off, value))
        return self.kernels.numpy(value) if isinstance(value, torch.Tensor) else value

    def call(self, name: str, *arguments):
        """What a kernel returns."""
        return self.off(getattr(self.kernels, name)(*map(self.on, arguments)))

    def changed(self, name: str, *arguments) -> list:
        """The arguments after a kernel that changes some."""
        given = [self.on(argument) for argument in arguments]
        getattr(self.kernels, name)(*given)
        return [self.off(argument) for argument in given]


@pytest.fixture(params=["cpu", "cuda"])
def backend(request) -> Backend:
    """What is held against the reference."""
    if request.param == "cuda":
        return Backend("cuda", request.getfixturevalue("cuda"))
    return Backend(request.param, import_module(f"srt3d_ros.kernels.{request.param}"))


@pytest.fixture
def spreading(monkeypatch):
    """Sets by how many pixels surfaces may grow."""
    def spread(pixels: int) -> None:
        for name in ("cpu", "cuda", "reference"):
            if module := sys.modules.get(f"srt3d_ros.kernels.{name}.birth_death"):
                monkeypatch.setattr(module, "SPREAD", pixels)
    return spread
