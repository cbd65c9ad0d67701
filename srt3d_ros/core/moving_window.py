"""MovingWindow: the last W frames of a sensor that moves as one sketch, seen from where it is now."""

from collections import deque
from typing import Any

import numpy as np

from srt3d_ros.core.deskew import Deskewer
from srt3d_ros.core.frequencies import angular_frequencies, irf_spectrum
from srt3d_ros.core.motion import KEPT_NS, Pose, Trajectory
from srt3d_ros.core.sketch import Sketch

CELL = 3                # pixels along the side of the cells in which photons are kept or forgotten together
FALSE_ALARM_RATE = 1e-3     # probability that a cell forgets a frame of a world that stands still
REGISTERED = 0.25       # widths of the matched filter's peak to which a motion and ranges are sure to bring photons


class MovingWindow:
    """Adds up frames, each moved from its own instant to the newest one's: photons are moved once, not again and again.

    From the newest frame back, a cell stops at the first frame whose photons contradict those added so far: what moves
    is seen by one frame's photons, and what it uncovers forgets it. With Z the mean sketches of the n photons of 3 × 3
    cells,

        Q = Σ_l |Z_l − Z'_l|² / ((1/n + 1/n') (1 − |Z̄_l|²) + (ω_l τ)² |Z̄_l|²)

    has mean m at most where both see the same. Its terms are correlated: photons of one surface swing all of them. The
    correlation of two is at most ½, reached by bright surfaces, then the largest eigenvalue is λ = (m + 1) / 2, and
    P(Q > m − λ + λ ln(1/p)) is about p. τ forgives what motion and ranges are wrong by.

    Args:
        deskewer: of the frames' sensor, on the CPU.

    Attributes:
        frames: W.
    """

    def __init__(self, deskewer: Deskewer):
        self.frames, self._deskewer = 1, deskewer
        self._kept: deque[Sketch] = deque()
        sensor, m = deskewer.sensor, len(deskewer.frequencies)
        largest = (m + 1) / 2
        self._most = m - largest - largest * np.log(FALSE_ALARM_RATE)
        omega = angular_frequencies(deskewer.frequencies, sensor.num_bins)
        energy = np.abs(np.atleast_2d(irf_spectrum(sensor, deskewer.frequencies)).mean(axis=0))**2
        width = np.sqrt(energy.sum() / (omega**2 * energy).sum())
        self._forgiven = ((omega * REGISTERED * width)**2).astype(np.float32)

    def reset(self) -> None:
        """Forget all frames."""
        self._kept.clear()

    def add(self, sketch: Sketch, trajectory: Trajectory, ranges: Any) -> Sketch:
        """The sketch of the window whose newest frame is this, at its stamp, both with parts of photons.

        Frames that the trajectory has forgotten leave the window.

        Args:
            ranges: as of `Deskewer.filled`.
        """
        while self._kept and (len(self._kept) >= self.frames
                              or not 0 <= sketch.stamp_ns - self._kept[0].stamp_ns <= KEPT_NS):
            self._kept.popleft()
        total = self._add_up(sketch, trajectory, ranges) if self._kept else sketch
        if self.frames > 1:
            self._kept.append(sketch)
        return total

    def _add_up(self, newest: Sketch, trajectory: Trajectory, ranges: Any) -> Sketch:
        now, variance = newest.stamp_ns, newest.added_variance
        sums, numbers = self._deskewer.move(newest, Pose(), ranges)
        seen, kept = _in_cells(sums, numbers), True
        for old in reversed(self._kept):
            if not trajectory.covers(old.stamp_ns, now):
                break
            moved = self._deskewer.move(old, trajectory.motion(old.stamp_ns, now), ranges)
            cells = _in_cells(*moved)
            kept = kept & ~self._contradicts(seen * kept, cells * kept)
            if not kept.any():
                break
            seen += cells * kept
            pixels = kept[..., 0].repeat(CELL, axis=0).repeat(CELL, axis=1)[:numbers.shape[0], :numbers.shape[1]]
            sums += moved[0] * pixels[..., None]
            numbers += moved[1] * pixels
            variance = max(variance, old.added_variance)
        return self._deskewer.read((sums, numbers), ranges, now, variance)

    def _contradicts(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Of sums and numbers of cells: whether those around a cell cannot have seen the same; [rows, cols, 1]."""
        first, second = _around(first), _around(second)
        n, other = (np.maximum(values[..., -1:].real, 1e-3) for values in (first, second))
        apart = np.abs(first[..., :-1] / n - second[..., :-1] / other)**2
        mean = np.abs((first + second)[..., :-1] / (n + other))**2
        noise = (1 / n + 1 / other) * np.maximum(1 - mean, 0.01) + self._forgiven * mean
        return (apart / noise).sum(axis=-1, keepdims=True) > self._most


def _in_cells(sums: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Sums over cells of CELL × CELL pixels, of the sums and, last, of the numbers; complex64 [⌈rows / CELL⌉, …]."""
    both = []
    for values in (sums, numbers[..., None]):
        rows = values[::CELL].copy()            # slices: ten times as fast as np.add.reduceat
        for k in range(1, CELL):
            rows[:len(values[k::CELL])] += values[k::CELL]
        cells = rows[:, ::CELL].copy()
        for k in range(1, CELL):
            cells[:, :rows[:, k::CELL].shape[1]] += rows[:, k::CELL]
        both.append(cells)
    return np.concatenate(both, axis=-1)


def _around(cells: np.ndarray) -> np.ndarray:
    """Sums over 3 × 3 cells."""
    for axis in (0, 1):
        padded = np.pad(cells, [(1, 1) if axis == side else (0, 0) for side in range(3)])
        cells = sum(np.take(padded, np.arange(k, k + cells.shape[axis]), axis=axis) for k in range(3))
    return cells
