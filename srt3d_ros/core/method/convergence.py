"""Convergence: which background a frame is reconstructed with, and how often a first frame."""

from collections.abc import Callable
from typing import Self

from srt3d_ros.core.method.background import Background, BackgroundEstimate
from srt3d_ros.core.method.found import Found
from srt3d_ros.core.sketching.sums import PhaseSums

PASSES = 8              # over a first frame, at most


class Convergence:
    """Reconstructs frames with the background of least misfit, and corrects it by what their points leave.

    Args:
        background: of the sensor.
        frame: from a sketch, what is removed from it, and points to start from or None, to what it shows.
        one_surface: the same with one surface a pixel; None if `frame` has no more.
    """

    def __init__(self, background: Background, frame: Callable[..., Found], one_surface: Self | None = None):
        self._background, self._frame, self._one_surface = background, frame, one_surface

    def first(self, sketch: PhaseSums) -> tuple[Found, BackgroundEstimate]:
        """What a first frame shows once its background has converged, and the background of the next frame."""
        found, learned = self.next(sketch, self._background.first)
        for _ in range(PASSES - 1):
            if learned.converged:
                break
            found, learned = self.next(sketch, learned)
            if learned.mean is None:        # the candidates explain the frame no better
                break
        return found, learned

    def next(self, sketch: PhaseSums, learned: BackgroundEstimate, start=None) -> tuple[Found, BackgroundEstimate]:
        """What a frame shows with the background of the frame before, or a better one; and that of the next frame."""
        if candidates := self._candidates(sketch, learned):
            tried = [(self._frame(sketch, self._background.removed(each, sketch)), each) for each in candidates]
            found, removed = min(tried, key=lambda one: one[0].unexplained.misfit)
        else:
            found, removed = self._frame(sketch, self._background.removed(learned, sketch), start), learned
        return found, self._background.learned(removed, found)

    def _candidates(self, sketch: PhaseSums, learned: BackgroundEstimate) -> tuple[BackgroundEstimate, ...]:
        """Uneven backgrounds to try on a frame; none if `learned` is used."""
        candidates = self._background.candidates(sketch, learned)
        if not candidates or not self._one_surface:
            return candidates
        # Further surfaces would be fitted to the background, so one surface a pixel decides on it.
        _, settled = self._one_surface.first(sketch)
        return candidates[:1] if settled.mean is None else (settled,)
