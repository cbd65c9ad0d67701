"""The CPU as a device: arrays stay in memory, and small frames run on one thread."""

import threading
from collections.abc import Callable

import numba
import numpy as np

ON_HOST = True
# Up to so many pixels one thread is at least as fast as two, which wake each other for every kernel (2.7 against 3.4 ms
# for 32 × 32, 6.5 against 7.2 ms for 64 × 64), and leaves the other core to other nodes.
SERIAL_PIXELS = 64 * 64


class _Memory(threading.local):
    """Each thread's arrays by name, and whether it is computing a frame."""

    def __init__(self):
        self.arrays: dict[str, np.ndarray] = {}
        self.in_frame = False


_memory = _Memory()


def borrow(name: str, shape: tuple, zero: bool = False) -> np.ndarray:
    """An array of 0; within a `recorded` frame the one that the last frame had by this name, with its values.

    Asking the system for memory again would take longer than some steps. `zero` clears the values.
    """
    found = _memory.arrays.get(name) if _memory.in_frame else None
    if found is None or found.shape != shape:
        found = np.zeros(shape, np.float32)
        if _memory.in_frame:
            _memory.arrays[name] = found
    elif zero:
        found[:] = 0
    return found


def array(values: np.ndarray) -> np.ndarray:
    return np.require(values, requirements="CA")


def numpy(values: np.ndarray) -> np.ndarray:
    return values


def unpack(*points) -> tuple:
    return points


def fused(function: Callable) -> Callable:
    return function


def recorded(function: Callable) -> Callable:
    def frame(*inputs):
        arrays = [values if values is None else array(values) for values in inputs]
        threads = numba.get_num_threads()
        numba.set_num_threads(1 if arrays[0].size <= SERIAL_PIXELS else threads)
        _memory.in_frame = True
        try:
            return function(*arrays)
        finally:
            _memory.in_frame = False
            numba.set_num_threads(threads)
    return frame
