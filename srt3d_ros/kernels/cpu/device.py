"""Arrays on the device, which is this machine's memory, and the threads of a frame."""

import threading
from collections.abc import Callable

import numba
import numpy as np

ON_HOST = True
# Pixels of a frame that one thread does as fast as two, which wake each other for every kernel: 2.7 against 3.4 ms for
# 32 × 32, 6.5 against 7.2 ms for 64 × 64, and the other core is free for other nodes.
SERIAL_PIXELS = 64 * 64


class _Memory(threading.local):
    """Of a thread's frames: arrays by name, and whether a frame is being computed."""

    def __init__(self):
        self.arrays: dict[str, np.ndarray] = {}
        self.in_frame = False


_memory = _Memory()


def borrow(name: str, shape: tuple, zero: bool = False) -> np.ndarray:
    """Within a `recorded` frame the array that the last frame had by this name, else a new one; new ones are 0.

    To ask the system for memory again would cost more than some steps.
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
