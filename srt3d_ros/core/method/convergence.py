"""Which background a frame is reconstructed with, and how often a first frame."""

from srt3d_ros.core.method.background import Background, BackgroundEstimate
from srt3d_ros.core.method.frame import Found, Frames
from srt3d_ros.core.method.thresholds import Scores
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.kernels.contract import Array

PASSES = 8              # over a first frame, at most


def first_frame(frames: Frames, background: Background, scores: Scores, sketch: PhaseSums
                ) -> tuple[Found, BackgroundEstimate]:
    """What a first frame shows once its background has converged, and the background of the next frame."""
    found, learned = next_frame(frames, background, scores, sketch, background.first)
    for _ in range(PASSES - 1):
        if learned.converged:
            break
        found, learned = next_frame(frames, background, scores, sketch, learned)
        if learned.mean is None:        # the candidates explain the frame no better
            break
    return found, learned


def next_frame(frames: Frames, background: Background, scores: Scores, sketch: PhaseSums, learned: BackgroundEstimate,
               start: Array | None = None) -> tuple[Found, BackgroundEstimate]:
    """What a frame shows with the background of the frame before, or a better one; and that of the next frame."""
    candidates = background.candidates(sketch, learned)
    if candidates and frames.surfaces > 1:
        # Further surfaces would be fitted to the background, so one surface a pixel decides on it.
        _, settled = first_frame(frames.with_one_surface, background, scores, sketch)
        candidates = candidates[:1] if settled.mean is None else [settled]
    if not candidates:
        found = frames(scores, sketch, background.removed(learned, sketch), start)
        return found, background.learned(learned, found.unexplained)
    tried = [(frames(scores, sketch, background.removed(each, sketch)), each) for each in candidates]
    found, removed = min(tried, key=lambda one: one[0].unexplained.misfit)
    return found, background.learned(removed, found.unexplained)
