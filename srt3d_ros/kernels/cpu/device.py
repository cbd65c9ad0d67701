"""The CPU as a device: arrays stay in memory, and small frames run on one thread."""

from collections.abc import Callable

import numba
import numpy as np

# Up to so many pixels one thread is at least as fast as two, which wake each other for every kernel (2.7 against 3.4 ms
# for 32 × 32, 6.5 against 7.2 ms for 64 × 64), and leaves the other core to other nodes.
SERIAL_PIXELS = 64 * 64
CACHE_LINE = 64         # bytes; vectors across two of them are slow


def zeros(*shape: int) -> np.ndarray:
    """float32 zeros from the start of a cache line. The system gives memory when it is first written to."""
    size = int(np.prod(shape))
    memory = np.zeros(size + CACHE_LINE // 4, np.float32)
    first = -memory.ctypes.data % CACHE_LINE // 4
    return memory[first:first + size].reshape(shape)


def array(values: np.ndarray) -> np.ndarray:
    return np.require(values, requirements="CA")


def numpy(values: np.ndarray) -> np.ndarray:
    return values


def unpack(*points) -> tuple:
    return points


def as_frame(function: Callable) -> Callable:
    def frame(*inputs):
        arrays = [values if values is None else array(values) for values in inputs]
        threads = numba.get_num_threads()
        numba.set_num_threads(1 if arrays[0].size <= SERIAL_PIXELS else threads)
        try:
            return function(*arrays)
        finally:
            numba.set_num_threads(threads)
    return frame
