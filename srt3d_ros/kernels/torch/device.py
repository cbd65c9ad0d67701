"""Where the kernels compute, and in which type: `Kernels` has them, and takes arrays there and back."""

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
    fused = staticmethod(fused)

    def __init__(self, functions: dict[str, Callable], device: str, dtype: torch.dtype):
        vars(self).update(functions)
        self.device, self.dtype, self._is_gpu = device, dtype, device == "cuda"

    def load(self):
        """Nothing waits to be compiled."""

    def array(self, values):
        """The values of a NumPy array on the device, contiguous; may be the same array."""
        values = np.ascontiguousarray(values)
        if np.iscomplexobj(values):
            values = values.view(values.real.dtype).reshape(*values.shape, 2)
        tensor = torch.from_numpy(values)
        tensor = tensor.pin_memory() if self._is_gpu else tensor
        return tensor.to(self.device, self.dtype if tensor.is_floating_point() else None, non_blocking=True)

    def numpy(self, values):
        """The NumPy array of an array on the device; waits for the kernels that write it."""
        dtype = torch.float32 if values.is_floating_point() else values.dtype
        return torch.empty(values.shape, dtype=dtype, pin_memory=self._is_gpu).copy_(values).numpy()

    def unpack(self, points, number) -> tuple:
        """Row, column, rank in the pixel, values and xyz of the points of `collect` (`unpacked`)."""
        return unpacked(self.numpy(points[:int(number)]))       # two copies: the second is of the points that there are

    def recorded(self, function: Callable) -> Callable:
        """A function of arrays, the first [rows, cols], that a GPU records in a graph and replays for each frame.

        It takes NumPy arrays, arrays on the device, or None; what it returns stays there, until the next frame.
        """
        frames: dict[tuple, Callable] = {}

        def frame(*inputs):
            arrays = [self.array(each) if isinstance(each, np.ndarray) else each for each in inputs]
            if not self._is_gpu:
                return function(*arrays)
            kind = tuple(None if each is None else (each.shape, each.dtype) for each in arrays)
            if kind not in frames:
                frames[kind] = _recorded(function, arrays)
            return frames[kind](arrays)
        return frame


def _recorded(function: Callable, arrays: list) -> Callable:
    """The function, recorded in a CUDA graph with copies of these arrays, into which the next ones are copied.

    It first runs as it is, which compiles what is fused. Products of matrices are exact to the type: no TF32.
    """
    inputs, products = [None if each is None else each.clone() for each in arrays], torch.backends.cuda.matmul
    before, products.fp32_precision = products.fp32_precision, "ieee"
    try:
        aside = torch.cuda.Stream()
        aside.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(aside):
            function(*inputs)
        torch.cuda.current_stream().wait_stream(aside)
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph, capture_error_mode="thread_local"):
            outputs = function(*inputs)
    finally:
        products.fp32_precision = before

    def replay(arrays: list) -> tuple:
        for ours, given in zip(inputs, arrays):
            if ours is not None:
                ours.copy_(given, non_blocking=True)
        graph.replay()
        return outputs
    return replay
