"""The CUDA kernels' device: a GPU if there is one, else Triton's interpreter on the CPU."""

import os

import pytest
import torch

if not torch.cuda.is_available():
    os.environ["TRITON_INTERPRET"] = "1"        # triton reads it when the kernels are defined


@pytest.fixture(scope="session")
def cuda():
    """The CUDA kernels; skips the test where Triton is missing."""
    pytest.importorskip("triton")
    from srt3d_ros.kernels import cuda
    return cuda
