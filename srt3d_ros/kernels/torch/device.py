"""`Kernels`: the torch kernels on one device in one type, and copies of arrays to it and back."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import torch


class Kernels:
    """The kernels on one device (`kernels.contract.Kernels`); a GPU allocates what a frame needs as it records it.

    Args:
        functions: by name.
        device: named as in torch.
        dtype: the type of all real numbers.
    """

    def __init__(self, functions: dict[str, Callable], device: str, dtype: torch.dtype):
        vars(self).update(functions)
        self.device, self.dtype, self._is_gpu = device, dtype, device == "cuda"

    def for_shape(self, rows: int, cols: int, surfaces: int, frequencies: tuple[int, ...]) -> "Kernels":
        return self

    def array(self, values):
        if np.iscomplexobj(values):
            values = np.ascontiguousarray(values).view(values.real.dtype).reshape(*values.shape, 2)
        dtype = torch.from_numpy(np.empty(0, values.dtype)).dtype
        dtype = self.dtype if dtype.is_floating_point else dtype
        ours = torch.empty(values.shape, dtype=dtype, pin_memory=self._is_gpu)
        ours.numpy()[...] = values          # NumPy's copy needs no other thread; torch's waits for all of them
        return ours.to(self.device, non_blocking=True)

    def numpy(self, values):
        dtype = torch.float32 if values.is_floating_point() else values.dtype
        return torch.empty(values.shape, dtype=dtype, pin_memory=self._is_gpu).copy_(values).numpy()

    def unpack(self, values, xyz, number) -> tuple:
        """The first `number` points of `collect`."""
        there = slice(int(number))
        values, xyz = self.numpy(values[:, there]).astype(np.float32, copy=False), self.numpy(xyz[there])
        row, col, rank = values[3:]
        return row.astype(np.uint16), col.astype(np.uint16), rank.astype(np.uint8), values[:3], xyz

    def as_frame(self, function: Callable) -> Callable:
        frames: dict[tuple, Callable] = {}
        pool = torch.cuda.graph_pool_handle() if self._is_gpu else None

        def frame(*inputs):
            arrays = [self.array(each) if isinstance(each, np.ndarray) else each for each in inputs]
            if not self._is_gpu:
                return function(*arrays)
            kind = tuple(None if each is None else (each.shape, each.dtype) for each in arrays)
            if kind not in frames:
                frames[kind] = _record(function, arrays, pool)
            return frames[kind](arrays)
        return frame


def _record(function: Callable, arrays: list, pool) -> Callable:
    """Record the function in a CUDA graph with copies of these arrays, into which later arrays are copied.

    The function first runs unrecorded, which compiles its fused parts. Graphs of one pool share temporary memory.
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
    """Multiply float32 matrices in float32 within the context; the user's setting returns afterwards."""
    products = torch.backends.cuda.matmul
    before, products.fp32_precision = products.fp32_precision, "ieee"
    try:
        yield
    finally:
        products.fp32_precision = before
