"""Where the kernels compute, and in which type: `Kernels` has them, and takes arrays there and back."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import torch

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
        """A copy of the values of a NumPy array on the device, contiguous; nothing waits for it to arrive."""
        if np.iscomplexobj(values):
            values = np.ascontiguousarray(values).view(values.real.dtype).reshape(*values.shape, 2)
        dtype = torch.from_numpy(np.empty(0, values.dtype)).dtype
        dtype = self.dtype if dtype.is_floating_point else dtype
        ours = torch.empty(values.shape, dtype=dtype, pin_memory=self._is_gpu)
        ours.numpy()[...] = values          # NumPy's copy needs no other thread; torch's waits for all of them
        return ours.to(self.device, non_blocking=True)

    def numpy(self, values):
        """The NumPy array of an array on the device; waits for the kernels that write it."""
        dtype = torch.float32 if values.is_floating_point() else values.dtype
        return torch.empty(values.shape, dtype=dtype, pin_memory=self._is_gpu).copy_(values).numpy()

    def unpack(self, values, xyz, number) -> tuple:
        """The points of `collect`, which have room for all that there can be: what `Estimate` has from `row` on."""
        there = slice(int(number))
        values, xyz = self.numpy(values[:, there]).astype(np.float32, copy=False), self.numpy(xyz[there])
        row, col, rank = values[3:]
        return row.astype(np.uint16), col.astype(np.uint16), rank.astype(np.uint8), values[:3], xyz

    def recorded(self, function: Callable) -> Callable:
        """A function of arrays, the first [rows, cols], that a GPU records in a graph and replays for each frame.

        It takes NumPy arrays, arrays on the device, or None; what it returns stays there, until the next frame.
        """
        frames: dict[tuple, Callable] = {}
        pool = torch.cuda.graph_pool_handle() if self._is_gpu else None

        def frame(*inputs):
            arrays = [self.array(each) if isinstance(each, np.ndarray) else each for each in inputs]
            if not self._is_gpu:
                return function(*arrays)
            kind = tuple(None if each is None else (each.shape, each.dtype) for each in arrays)
            if kind not in frames:
                frames[kind] = _recorded(function, arrays, pool)
            return frames[kind](arrays)
        return frame


def _recorded(function: Callable, arrays: list, pool) -> Callable:
    """The function, recorded in a CUDA graph with copies of these arrays, into which the next ones are copied.

    It first runs as it is, which compiles what is fused. Graphs of one pool share the memory of what does not last.
    """
    inputs = [None if each is None else each.clone() for each in arrays]
    with exact_products():
        aside = torch.cuda.Stream()
        aside.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(aside):
            function(*inputs)
        torch.cuda.current_stream().wait_stream(aside)
        graph = torch.cuda.CUDAGraph()
        torch.cuda.empty_cache()            # of the first run
        with torch.cuda.graph(graph, pool, capture_error_mode="thread_local"):
            outputs = function(*inputs)

    def replay(arrays: list) -> tuple:
        for ours, given in zip(inputs, arrays):
            if ours is not None:
                ours.copy_(given, non_blocking=True)
        graph.replay()
        return outputs
    return replay


@contextmanager
def exact_products() -> Iterator[None]:
    """Products of float32 matrices are float32's inside, whatever the user has set, and has again behind it."""
    products = torch.backends.cuda.matmul
    before, products.fp32_precision = products.fp32_precision, "ieee"
    try:
        yield
    finally:
        products.fp32_precision = before
