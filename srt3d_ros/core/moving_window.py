"""MovingWindow: the last W frames of a sensor that moves as one sketch, seen from where it is now."""

from collections import deque

import numpy as np

from srt3d_ros.core.deskew import Deskewer
from srt3d_ros.core.motion import Trajectory
from srt3d_ros.core.sketch import Sketch


class MovingWindow:
    """Adds up frames, each moved from its own instant to the newest one's: photons are moved once, not again and again.

    Args:
        deskewer: of the frames' sensor.
    """

    def __init__(self, deskewer: Deskewer):
        self.frames, self._deskewer = 1, deskewer
        self._kept: deque[Sketch] = deque()

    def reset(self) -> None:
        """Forget all frames."""
        self._kept.clear()

    def add(self, sketch: Sketch, trajectory: Trajectory, range_m: np.ndarray | None = None) -> Sketch:
        """The sketch of the window whose newest frame is this, deskewed to its stamp."""
        while len(self._kept) >= self.frames:
            self._kept.popleft()
        total, now = sketch, sketch.stamp_ns
        for old in self._kept:
            if trajectory.covers(old.stamp_ns, now):
                total = total + self._deskewer.move(old, trajectory.motion(old.stamp_ns, now), now, range_m)
        if self.frames > 1:
            self._kept.append(sketch)
        return total if total is sketch else Sketch(total.frequencies, total.sums, total.photons, now,
                                                    total.added_variance)
