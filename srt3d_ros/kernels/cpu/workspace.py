"""The memory of frames of a shape, kept from one to the next: asking the system again takes longer than some steps."""

import numba
import numpy as np

from srt3d_ros.kernels.cpu.device import zeros
from srt3d_ros.kernels.maps import FIELDS, padded_shape


class Workspace:
    """Arrays of frames of rows × cols pixels with K surfaces and frequencies k_l; each kernel asks for its own by name.

    The first time they are 0, later as the last frame has left them.
    """

    def __init__(self, rows: int, cols: int, surfaces: int, frequencies: tuple[int, ...]):
        self.shape, self.surfaces, self.frequencies = (rows, cols), surfaces, frequencies
        (self.height, self.width), self.threads = padded_shape(rows, cols), numba.config.NUMBA_NUM_THREADS
        self._arrays: dict[tuple, np.ndarray] = {}

    def array(self, name: str, *shape: int, of: type = np.float32) -> np.ndarray:
        key = name, *shape
        if key not in self._arrays:
            self._arrays[key] = zeros(*shape).view(of)
        return self._arrays[key]

    def map(self, name: str, *channels: int) -> np.ndarray:
        """A padded map [rows', …, cols']."""
        return self.array(name, self.height, *channels, self.width)

    def other_state(self, state: np.ndarray | None = None) -> np.ndarray:
        """Of two states, of which a step reads one and writes the other, the one that is not `state`."""
        first, second = (self.map(name, self.surfaces, FIELDS) for name in ("state", "next state"))
        return second if state is first else first
