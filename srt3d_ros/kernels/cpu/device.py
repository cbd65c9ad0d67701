"""Arrays on the device, which is this machine's memory, and frames, which are done when they have been submitted."""

from collections.abc import Callable

import numba
import numpy as np

ON_HOST = True
WARM_FRAMES = 0         # kernels are compiled once for frames of any size
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


def photon_array(values: np.ndarray) -> np.ndarray:
    """A view that cannot be written: numba would compile the kernels anew for photons in read-only memory."""
    view = np.ascontiguousarray(values).view()
    view.flags.writeable = False
    return view


def numpy(values: np.ndarray) -> np.ndarray:
    return values


class FrameStream:
    """Frames through a function, of whose arrays the first has a number for each pixel."""

    def __init__(self, function: Callable):
        self._function = function

    def submit(self, *frame) -> Callable[[], tuple]:
        # A sketch on a GPU consists of tensors.
        arrays = [array(values if isinstance(values, np.ndarray) else values.cpu().numpy()) for values in frame]
        threads = numba.get_num_threads()
        numba.set_num_threads(1 if arrays[0].size <= SERIAL_PIXELS else threads)
        try:
            results = self._function(*arrays)
        finally:
            numba.set_num_threads(threads)
        return lambda: results
