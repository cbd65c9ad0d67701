"""Where the oracle computes, and in which type: `Kernels` has its functions, and takes arrays there and back."""

from collections.abc import Callable
from functools import partial

import numpy as np
import torch

from srt3d_ros.kernels.oracle.finalise import unpack


class Kernels:
    """The kernels on one device: what `cpu` has as a module.

    Args:
        functions: by name.
        device: torch's name of it.
        dtype: of all real numbers.
    """

    ON_HOST = False             # arrays are not NumPy's

    def __init__(self, functions: dict[str, Callable], device: str, dtype: torch.dtype):
        vars(self).update(functions)
        self.device, self.dtype = device, dtype
        self.Scratch = partial(Scratch, device, dtype)

    def array(self, values):
        """The values of a NumPy array on the device, contiguous; may be the same array."""
        tensor = torch.from_numpy(np.array(values, order="C"))
        wanted = self.dtype if tensor.is_floating_point() else self.dtype.to_complex() if tensor.is_complex() else None
        return tensor.to(self.device, wanted)

    def numpy(self, values):
        """The NumPy array of an array on the device; waits for the kernels that write it."""
        single = {torch.float64: torch.float32, torch.complex128: torch.complex64}.get(values.dtype, values.dtype)
        return values.to("cpu", single).numpy()

    def run_frame(self, function, *frame):
        """The results of a function of a frame's arrays [rows, cols, …], as NumPy arrays.

        Products of matrices are exact to the type: no TF32.

        Args:
            function: of the arrays on the device; returns a tuple of arrays that ends with the points of `collect`.
            frame: NumPy arrays, the first [rows, cols].

        Returns:
            The arrays, and the points as `unpack` gives them.
        """
        precision = torch.get_float32_matmul_precision()
        torch.set_float32_matmul_precision("highest")
        try:
            *arrays, points, number = function(*map(self.array, frame))
        finally:
            torch.set_float32_matmul_precision(precision)
        return *map(self.numpy, arrays), *unpack((points, number))


class Scratch:
    """Memory that a reconstruction keeps from frame to frame."""

    def __init__(self, device: str, dtype: torch.dtype):
        self._device, self._dtype, self._tensors = device, dtype, {}

    def array(self, name: str, shape: tuple, zero: bool = False) -> torch.Tensor:
        """The array of this name and shape: as it was left, or 0 if `zero` is set or it is new."""
        found = self._tensors.get((name, *shape))
        if found is None:
            found = torch.zeros(tuple(shape), dtype=self._dtype, device=self._device)
            self._tensors[name, *shape] = found
        elif zero:
            found.zero_()
        return found
