"""Memory that a reconstruction keeps from frame to frame: a CUDA graph needs it to stay where it is."""

from functools import lru_cache

import numpy as np
import torch

from srt3d_ros.kernels.cuda.device import DEVICE, array


class Scratch:
    """Tensors by name and shape; none is ever given up."""

    def __init__(self):
        self._tensors = {}

    def array(self, name: str, shape: tuple, zero: bool = False) -> torch.Tensor:
        """The float32 tensor of this name and shape; what is in it is old, or 0."""
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
