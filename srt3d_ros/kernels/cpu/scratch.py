"""Arrays on the device, which is this machine's memory.

A reconstruction keeps its memory from frame to frame: to ask the system for it again costs more than some steps.
"""

from collections.abc import Callable

import numba
import numpy as np

ON_HOST = True
WARM_FRAMES = 0         # kernels are compiled once for frames of any size
# Pixels of a frame that one thread does as fast as two, which wake each other for 70 kernels: 2.7 against 3.4 ms for
# 32 × 32, 6.5 against 7.2 ms for 64 × 64, and the other core is free for other nodes.
SERIAL_PIXELS = 64 * 64


class Scratch(dict):
    """Arrays by name; an array lasts until it is asked for again."""

    def array(self, name: str, shape: tuple, zero: bool = False) -> np.ndarray:
        """The float32 array of this name, made anew if its shape has changed; what is in it is old, or 0."""
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
    """A NumPy array on the device."""
    return np.ascontiguousarray(values)


def photon_array(values: np.ndarray) -> np.ndarray:
    """A view that cannot be written: numba would compile the kernels anew for photons in read-only memory."""
    view = np.ascontiguousarray(values).view()
    view.flags.writeable = False
    return view


def numpy(values: np.ndarray) -> np.ndarray:
    """The NumPy array of an array on the device."""
    return values


class FrameStream:
    """Frames through a sequence of kernels. Here a frame is done when it has been submitted.

    Args:
        function: of the frame's arrays, the first of which has a number for each pixel; returns a tuple of arrays.
    """

    def __init__(self, function: Callable):
        self._function = function

    def submit(self, *frame) -> Callable[[], tuple]:
        """Begin a frame; what is returned waits for the results."""
        arrays = [array(_from_device(values)) for values in frame]
        threads = numba.get_num_threads()
        numba.set_num_threads(1 if arrays[0].size <= SERIAL_PIXELS else threads)
        try:
            results = self._function(*arrays)
        finally:
            numba.set_num_threads(threads)
        return lambda: results


def _from_device(values) -> np.ndarray:
    """The NumPy array of a tensor, which a sketch on a GPU consists of."""
    return values if isinstance(values, np.ndarray) else values.cpu().numpy()
