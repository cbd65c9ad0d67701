"""The memory of a frame, made once for all frames of a shape: asking the system again takes longer than some steps."""

import numba
import numpy as np

from srt3d_ros.kernels.cpu.method.voters import PLACES, VOTER
from srt3d_ros.kernels.maps import FIELDS, LANES, TERMS, padded_shape

CACHE_LINE = 64         # bytes; vectors across two of them are slow


def zeros(*shape: int) -> np.ndarray:
    """float32 zeros from the start of a cache line."""
    size = int(np.prod(shape))
    memory = np.zeros(size + CACHE_LINE // 4, np.float32)
    first = -memory.ctypes.data % CACHE_LINE // 4
    return memory[first:first + size].reshape(shape)


class Workspace:
    """Arrays of frames of rows × cols pixels with K surfaces and m frequencies; padded maps unless said otherwise.

    Their values are those of the last frame.
    """

    def __init__(self, rows: int, cols: int, surfaces: int, frequencies: int):
        (height, width), threads = padded_shape(rows, cols), numba.config.NUMBA_NUM_THREADS
        # The frame, and what surfaces leave of it
        self.matched, self.residual = zeros(height, 2 * frequencies, width), zeros(height, 2 * frequencies, width)
        self.counts = zeros(height, width)
        # Points: two states, of which the steps read one and write the other; data terms, of pixels and of cells
        self.states = zeros(height, surfaces, FIELDS, width), zeros(height, surfaces, FIELDS, width)
        self.terms, self.cell_terms = zeros(height, surfaces, TERMS, width), zeros(height, surfaces, TERMS, width)
        self.known = zeros(height, surfaces, 2, width)              # of `pooled_step`
        self.ratios = zeros(height, surfaces, width)                # of `log_likelihood_ratio`
        # Birth and death: the pixels to decide, in each row and in all, what they choose, and 1 near a change
        self.columns, self.numbers = np.zeros((height, width), np.int32), np.zeros(height, np.int32)
        self.listed, self.near = np.zeros((2, height * width), np.int32), zeros(height, width)
        self.chosen, self.chosen_ratios = zeros(surfaces, FIELDS, height * width), zeros(surfaces, height * width)
        self.voters = zeros(threads, PLACES * surfaces, VOTER, LANES)
        self.undecided_sketches = zeros(threads, 2 * frequencies, LANES)
        # Trimming: v, n and g r at rims, and 1 where a used pixel has no surface
        self.rim, self.blank = zeros(height, 3, width), zeros(height, width)

    def other_state(self, state: np.ndarray) -> np.ndarray:
        """The state to write into when this one is read."""
        first, second = self.states
        return second if state is first else first
