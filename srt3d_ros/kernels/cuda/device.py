"""Where the CUDA kernels run, how arrays get there and back, and memory that stays where it is.

With TRITON_INTERPRET=1 in the environment before triton is imported, Triton runs the kernels through NumPy on tensors
of the CPU: slow, but the same code, so that they can be tested without a GPU.
"""

import os
from functools import lru_cache

import numpy as np
import torch
import triton

# One rounding for a product and its sum, which is also twice as fast: from version 3.10 on Triton wants to be asked for
# it. An explicit choice in the environment wins.
os.environ.setdefault("TRITON_DEFAULT_FP_FUSION", "1")

DEVICE = "cpu" if triton.knobs.runtime.interpret else "cuda"
ON_HOST = False                 # not even if they are interpreted: tensors are not NumPy arrays


def array(values) -> torch.Tensor:
    return torch.from_numpy(np.array(values, order="C")).to(DEVICE)


photon_array = array


def numpy(values: torch.Tensor) -> np.ndarray:
    return values.cpu().numpy()


class Scratch:
    """Tensors by name and shape; none is ever given up: a CUDA graph needs them to stay where they are."""

    def __init__(self):
        self._tensors = {}

    def array(self, name: str, shape: tuple, zero: bool = False) -> torch.Tensor:
        found = self._tensors.get((name, *shape))
        if found is None:
            found = self._tensors[name, *shape] = torch.zeros(tuple(shape), device=DEVICE)
        elif zero:
            found.zero_()
        return found


def borrow(scratch: Scratch | None, name: str, shape: tuple, zero: bool = False) -> torch.Tensor:
    """The tensor of this name, or a new one if there is no scratch."""
    if scratch is not None:
        return scratch.array(name, shape, zero)
    return torch.zeros(shape, device=DEVICE) if zero else torch.empty(shape, device=DEVICE)


def constant(values: np.ndarray) -> torch.Tensor:
    """float32 values on the device, copied there once: a graph that is being recorded cannot wait for a copy."""
    return _constant(values.astype(np.float32).tobytes())


@lru_cache(maxsize=None)        # graphs read them for as long as they live
def _constant(values: bytes) -> torch.Tensor:
    return array(np.frombuffer(values, np.float32))
