"""The CUDA kernels' device: a GPU if there is one, else Triton's interpreter on the CPU."""

import os
from importlib.util import find_spec

import pytest
import torch

INTERPRET = "TRITON_INTERPRET"          # read when kernels are defined, which is while tests are collected, and run
interpreted = find_spec("triton") is not None and not torch.cuda.is_available()
if interpreted:
    os.environ[INTERPRET] = "1"
    import srt3d_ros.kernels.cuda  # noqa: F401


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
