"""Arrays of the reference, tensors in double precision on the CPU; `array` and `numpy` convert from and to single."""

from dataclasses import fields, is_dataclass, replace
from functools import wraps

import numpy as np
import torch

from srt3d_ros.kernels.reference.finalise import unpack

ON_HOST = False                 # not NumPy's
DOUBLE = {np.dtype(np.float32): np.float64, np.dtype(np.complex64): np.complex128}
SINGLE = {torch.float64: torch.float32, torch.complex128: torch.complex64}


def array(values):
    """The values of a NumPy array on the device, contiguous; may be the same array."""
    return torch.from_numpy(np.array(values, DOUBLE.get(values.dtype, values.dtype), order="C"))


def numpy(values):
    """The NumPy array of an array on the device; waits for the kernels that write it."""
    return values.to(SINGLE.get(values.dtype, values.dtype)).numpy()


class Scratch:
    """Memory that a reconstruction keeps from frame to frame."""

    dtype, device = torch.float64, "cpu"

    def __init__(self):
        self._tensors = {}

    def array(self, name: str, shape: tuple, zero: bool = False) -> torch.Tensor:
        """The array of this name and shape: as it was left, or 0 if `zero` is set or it is new."""
        found = self._tensors.get((name, *shape))
        if found is None:
            found = torch.zeros(tuple(shape), dtype=self.dtype, device=self.device)
            self._tensors[name, *shape] = found
        elif zero:
            found.zero_()
        return found


def run_frame(function, *frame):
    """The results of a function of a frame's arrays [rows, cols, …], as NumPy arrays.

    Args:
        function: of the arrays on the device; returns a tuple of arrays that ends with the points of `collect`.
        frame: NumPy arrays, the first [rows, cols].

    Returns:
        The arrays, and the points as `unpack` gives them.
    """
    *arrays, points, number = function(*map(array, frame))
    return *map(numpy, arrays), *unpack((points, number))


def in_numpy(function):
    """The function, which is written for NumPy arrays, for tensors: they share their memory."""
    @wraps(function)
    def on_tensors(*arguments):
        results = function(*map(_as_numpy, arguments))
        return tuple(map(torch.from_numpy, results)) if isinstance(results, tuple) else \
            results if results is None else torch.from_numpy(results)
    return on_tensors


def _as_numpy(value):
    if is_dataclass(value):
        return replace(value, **{field.name: _as_numpy(getattr(value, field.name)) for field in fields(value)})
    return value.numpy() if isinstance(value, torch.Tensor) else value
