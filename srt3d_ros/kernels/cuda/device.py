"""Where the CUDA kernels run, and how arrays get there and back.

With TRITON_INTERPRET=1 in the environment before triton is imported, Triton runs the kernels through NumPy on tensors
of the CPU: slow, but the same code, so that they can be tested without a GPU.
"""

import numpy as np
import torch
import triton

DEVICE = "cpu" if triton.knobs.runtime.interpret else "cuda"


def array(values) -> torch.Tensor:
    """A contiguous copy of a NumPy array on the device."""
    return torch.from_numpy(np.array(values, order="C")).to(DEVICE)


def numpy(values: torch.Tensor) -> np.ndarray:
    """The NumPy array of a tensor on the device; waits for the kernels that write it."""
    return values.cpu().numpy()
