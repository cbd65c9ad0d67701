"""The backends that are held against the reference. CUDA's device is a GPU, or Triton's interpreter on the CPU."""

import os
import sys
from importlib.util import find_spec

import pytest
import torch

INTERPRET = "TRITON_INTERPRET"          # read when kernels are defined, which is while tests are collected, and run
interpreted = find_spec("triton") is not None and not torch.cuda.is_available()
if interpreted:
    os.environ[INTERPRET] = "1"
    from triton.runtime import interpreter

    import srt3d_ros.kernels.cuda  # noqa: F401
    # Else every sum of integers is made a second time to see whether it overflows, and without `debug` nobody looks.
    interpreter.interpreter_builder.options = interpreter.InterpreterOptions(sanitize_overflow=False)

from .frames import CPU, Backend  # noqa: E402


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


@pytest.fixture(params=["cpu", "cuda"])
def backend(request) -> Backend:
    """What is held against the reference."""
    if request.param == "cuda":
        return Backend("cuda", request.getfixturevalue("cuda"))
    return CPU


@pytest.fixture
def spreading(monkeypatch):
    """Sets by how many pixels surfaces may grow."""
    def spread(pixels: int) -> None:
        for name in ("cpu", "cuda", "reference"):
            if module := sys.modules.get(f"srt3d_ros.kernels.{name}.birth_death"):
                monkeypatch.setattr(module, "SPREAD", pixels)
    return spread
