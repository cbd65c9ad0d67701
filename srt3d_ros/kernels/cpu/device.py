"""Arrays on the device, which is this machine's memory, and the threads of a frame."""

from collections.abc import Callable

import numba
import numpy as np

ON_HOST = True
# Pixels of a frame that one thread does as fast as two, which wake each other for every kernel: 2.7 against 3.4 ms for
# 32 × 32, 6.5 against 7.2 ms for 64 × 64, and the other core is free for other nodes.
SERIAL_PIXELS = 64 * 64


class Scratch(dict):
    """Arrays by name, kept from frame to frame: to ask the system for memory again costs more than some steps."""

    def array(self, name: str, shape: tuple, zero: bool = False) -> np.ndarray:
        found = self.get(name)
        if found is None or found.shape != shape:
            found = self[name] = np.zeros(shape, np.float32)
        elif zero:
            found[:] = 0
        return found


def borrow(scratch: Scratch | None, name: str, shape: tuple, zero: bool = False) -> np.ndarray:
    """The array of this name, or a new one if there is no scratch."""
    if scratch is not None:
        return scratch.array(name, shape, zero)
    return np.zeros(shape, np.float32) if zero else np.empty(shape, np.float32)


def array(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values)


def numpy(values: np.ndarray) -> np.ndarray:
    return values


def run_frame(function: Callable, *frame) -> tuple:
    arrays, threads = [array(values) for values in frame], numba.get_num_threads()
    numba.set_num_threads(1 if arrays[0].size <= SERIAL_PIXELS else threads)
    try:
        return function(*arrays)
    finally:
        numba.set_num_threads(threads)
