"""Where the oracle computes, and in which type: `Kernels` has its functions, and takes arrays there and back."""

from collections.abc import Callable

import numpy as np
import torch

from srt3d_ros.kernels.oracle.collect import unpack


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

    def load(self):
        """Nothing waits to be compiled."""

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
            function: of the arrays on the device; returns an array that stays there, others, and the points of
                `collect`.
            frame: NumPy arrays, the first [rows, cols].

        Returns:
            The arrays, and the points as `unpack` gives them.
        """
        precision = torch.get_float32_matmul_precision()
        torch.set_float32_matmul_precision("highest")
        try:
            kept, *arrays, points, number = function(*map(self.array, frame))
        finally:
            torch.set_float32_matmul_precision(precision)
        return kept, *map(self.numpy, arrays), *unpack((points, number))
