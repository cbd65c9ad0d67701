"""Where the oracle computes, and in which type: `Kernels` has its functions, and takes arrays there and back."""

from collections.abc import Callable

import numpy as np
import torch

from srt3d_ros.kernels.torch.collect import unpacked
from srt3d_ros.kernels.torch.fusing import fused


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

    fused = staticmethod(fused)

    def array(self, values):
        """The values of a NumPy array on the device, contiguous; may be the same array."""
        values = np.ascontiguousarray(values)
        if np.iscomplexobj(values):
            values = values.view(values.real.dtype).reshape(*values.shape, 2)
        tensor = torch.from_numpy(values)
        return tensor.to(self.device, self.dtype if tensor.is_floating_point() else None)

    def numpy(self, values):
        """The NumPy array of an array on the device; waits for the kernels that write it."""
        return values.to("cpu", torch.float32 if values.is_floating_point() else None).numpy()

    def unpack(self, points, number) -> tuple:
        """Row, column, rank in the pixel, values and xyz of the points of `collect` (`unpacked`)."""
        return unpacked(self.numpy(points[:int(number)]))

    def recorded(self, function: Callable) -> Callable:
        """A function of arrays, the first [rows, cols], that a GPU records in a graph and replays for each frame.

        It takes NumPy arrays, arrays on the device, or None; what it returns stays there.
        """
        def frame(*inputs):
            return function(*(self.array(each) if isinstance(each, np.ndarray) else each for each in inputs))
        return frame
