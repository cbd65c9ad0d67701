"""Where the CUDA kernels run, and how arrays get there and back.

With TRITON_INTERPRET=1 in the environment before triton is imported, Triton runs the kernels through NumPy on tensors
of the CPU: slow, but the same code, so that they can be tested without a GPU.
"""

import os

import numpy as np
import torch
import triton

# One rounding for a product and its sum, which is also twice as fast: from version 3.10 on Triton wants to be asked for
# it. An explicit choice in the environment wins.
os.environ.setdefault("TRITON_DEFAULT_FP_FUSION", "1")

DEVICE = "cpu" if triton.knobs.runtime.interpret else "cuda"
ON_HOST = False                 # not even if they are interpreted: tensors are not NumPy arrays


def array(values) -> torch.Tensor:
    """A contiguous copy of a NumPy array on the device."""
    return torch.from_numpy(np.array(values, order="C")).to(DEVICE)


def photon_array(values) -> torch.Tensor:
    """A copy of the photons on the device."""
    return array(values)


def numpy(values: torch.Tensor) -> np.ndarray:
    """The NumPy array of a tensor on the device; waits for the kernels that write it."""
    return values.cpu().numpy()
