"""The memory of a frame, made once for all frames of a shape: asking the system again takes longer than some steps."""

import numba
import numpy as np

from srt3d_ros.kernels.constants import START_SCALES, WIDE_SCALE, cell_size
from srt3d_ros.kernels.cpu.device import zeros
from srt3d_ros.kernels.cpu.method.match import steering
from srt3d_ros.kernels.cpu.method.search import Memory
from srt3d_ros.kernels.cpu.method.voters import PLACES, Voter
from srt3d_ros.kernels.cpu.method.windows import SLANTS, Cells
from srt3d_ros.kernels.maps import FIELDS, LANES, SCORE, TERMS, padded_shape


class Workspace:
    """Arrays of frames of rows × cols pixels with K surfaces and frequencies k_l; padded maps unless said otherwise.

    Their values are those of the last frame.
    """

    def __init__(self, rows: int, cols: int, surfaces: int, frequencies: tuple[int, ...]):
        (height, width), threads, twice = padded_shape(rows, cols), numba.config.NUMBA_NUM_THREADS, 2 * len(frequencies)
        # The frame, and what surfaces leave of it
        self.matched, self.residual, self.counts = zeros(height, twice, width), zeros(height, twice, width), zeros(
            height, width)
        # Points: two states, of which a step reads one and writes the other; data terms, of pixels and of cells
        self.states = zeros(height, surfaces, FIELDS, width), zeros(height, surfaces, FIELDS, width)
        self.terms, self.cell_terms = zeros(height, surfaces, TERMS, width), zeros(height, surfaces, TERMS, width)
        self.stale = np.zeros((height, width // LANES), np.bool_)   # vectors of pixels whose terms are to be made anew
        self.known = zeros(height, surfaces, 2, width)              # of `pooled_step`
        self.ratios = zeros(height, surfaces, width)                # of `log_likelihood_ratio`
        # The start: 1 where a pixel is open; by sizes of cells, these, and what each thread needs
        self.wanted, self.cells, self.searches, self.steering = zeros(height, width), {}, {}, steering(frequencies)
        for step in {cell_size(sigma) for sigma in (*START_SCALES, WIDE_SCALE)}:
            high, wide = padded_shape(-(-rows // step), -(-cols // step))
            self.cells[step] = Cells(zeros(high, twice, wide), *(zeros(high, 1, wide) for _ in range(3)))
            self.searches[step] = Memory(
                zeros(threads, twice, wide), *(zeros(threads, 1, wide) for _ in range(2)),
                *(zeros(threads, wide) for _ in range(3)), zeros(threads, SCORE + 1, wide),
                zeros(threads, 2 * SLANTS, twice, wide), zeros(threads, twice + self.steering.cells + 1, LANES),
                np.zeros((threads, wide), np.int32))
        # Birth and death: the pixels to decide, in each row and in all, what they choose, and 1 near a change
        self.columns, self.numbers = np.zeros((height, width), np.int32), np.zeros(height, np.int32)
        self.listed, self.near = np.zeros((2, height * width), np.int32), zeros(height, width)
        self.chosen, self.chosen_ratios = zeros(surfaces, FIELDS, height * width), zeros(surfaces, height * width)
        self.voters = zeros(threads, PLACES * surfaces, len(Voter._fields), LANES)
        self.undecided_sketches = zeros(threads, twice, LANES)
        self.had = zeros(height, width)     # 1 where a pixel had points before
        # The end: v, n and g r at rims, and 1 where a used pixel has no surface
        self.rim, self.blank = zeros(height, 3, width), zeros(height, 1, width)
        # What is averaged around pixels, and each thread's means of a row; photons left, background, and what was taken
        self.compared, self.left, self.seen = zeros(height, 2 * surfaces, width), zeros(height, 2, width), zeros(
            height, 3, width)
        self.relief, self.smooth = zeros(height, 3 * surfaces, width), zeros(height, 3, LANES)
        self.means = zeros(threads, 3 * surfaces + 2, width)
        self.rest, self.background, self.taken = zeros(height, width), zeros(height, width), zeros(height, width)

    def other_state(self, state: np.ndarray) -> np.ndarray:
        """The state to write into when this one is read."""
        first, second = self.states
        return second if state is first else first
