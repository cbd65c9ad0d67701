"""Pooled: the default method, the paper's data term pooled along surfaces (docs/algorithm.md).

    J. Tachella, M. P. Sheehan, M. E. Davies, "Sketched RT3D: how to reconstruct billions of photons per second",
    ICASSP 2022.

As in the paper, Gauss-Newton steps on the depth t and the intensity r of every point alternate with a step that creates
and removes points. The paper then smooths depths with a denoiser. Here a point climbs the sum of the data terms of the
pixels around it instead, each weighted by how surely it sees the same surface: photons are shared, not depths.
`core.baselines.sketched.SRT3D` is the paper's method, step by step.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from srt3d_ros.core.method.background import Background, BackgroundEstimate, RemovedBackground
from srt3d_ros.core.method.frame import Frames
from srt3d_ros.core.method.irf_check import misplaced_share
from srt3d_ros.core.method.matched_frame import Matcher
from srt3d_ros.core.method.pile_up import PileUp
from srt3d_ros.core.method.thresholds import DEFAULT_FALSE_ALARM_RATE, Scores
from srt3d_ros.core.motion.trajectory import Trajectory
from srt3d_ros.core.motion.window import MovingWindow
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.sums import PhaseSums, noise_sketch
from srt3d_ros.kernels.devices import compile_kernels

PASSES = 8              # over a first frame, at most


class Pooled:
    """Reconstructs frames of one sensor in turn; remembers their background.

    Args:
        sensor: geometry, IRF and calibration.
        frequencies: the integers k_l of the sketches.
        surfaces: K, the most surfaces in a pixel, 1 … 4.
        false_alarm_rate: share of the pixels with background alone that show a point, at most 0.4.
        device: "cpu" or "cuda".
        background: how it spreads over the bins: "sensor": by its background_shape; "flat"; or "auto": what the last
            cloud leaves unexplained, if significant.
        window_frames: W, frames of which each cloud is made (`MovingWindow`).
    """

    def __init__(self, sensor: SensorModel, frequencies: Sequence[int], surfaces: int = 1,
                 false_alarm_rate: float = DEFAULT_FALSE_ALARM_RATE, device: str = "cpu", background: str = "auto",
                 window_frames: int = 1):
        self._window = MovingWindow(sensor, frequencies, window_frames) if window_frames > 1 else None
        self._matcher = Matcher(sensor, frequencies)
        self._background = Background(self._matcher, background)
        self._frames = Frames(self._matcher, device, surfaces)
        self._scores = Scores.of(false_alarm_rate, max(self._matcher.frequencies), self._matcher.used.size)
        self.forget()

    def forget(self) -> None:
        """Begin the next frame as if it were the first."""
        self._last: PointCloud | None = None        # no frame yet
        self._learned, self._piled_up = self._background.first, None
        self._plain: tuple[PhaseSums, PointCloud] | None = None
        if self._window is not None:
            self._window.forget()

    @property
    def misplaced_share(self) -> float:
        """Of the photons of the last cloud's surfaces, by `irf_check`; 0 if the background is uneven or pile-up was
        corrected, which leave as much."""
        return misplaced_share(self._matcher, *self._plain) if self._plain is not None else 0.0

    def __call__(self, sketch: PhaseSums, trajectory: Trajectory | None = None) -> PointCloud:
        """The point cloud of one frame's sketch, or of the window that ends with it, with the photons of one frame.

        Where the laser cycles are known, pile-up is corrected.

        Args:
            trajectory: of the sensor, for a window; None if it is at rest.
        """
        self._matcher.check(sketch)
        if self._window is not None:
            sketch = self._window(sketch, trajectory, self._last)
        cloud = self._cloud(sketch)
        if self._last is None and sketch.cycles:    # again: the first cloud says how much of the light is background
            cloud = self._cloud(sketch)
        self._last = cloud
        return cloud

    def _cloud(self, sketch: PhaseSums) -> PointCloud:
        """The cloud of a frame; the next one starts from its background and its pile-up."""
        piled_up = self._piled_up or self._pile_up.first if sketch.cycles else None
        plain = sketch if piled_up is None else self._pile_up.without_decay(sketch, piled_up)
        cloud, self._learned = (self._first(self._frames, plain) if self._last is None
                                else self._next(self._frames, plain, self._learned))
        cloud = replace(cloud, clutter=self._background.most_clutter(self._learned))
        self._plain = (sketch, cloud) if piled_up is None and self._learned.mean is None else None
        if piled_up is not None:
            cloud, self._piled_up = self._pile_up.corrected(cloud, sketch, piled_up)
        return cloud

    def _first(self, frames: Frames, sketch: PhaseSums) -> tuple[PointCloud, BackgroundEstimate]:
        """The cloud of a first frame once its background has converged, and the background of the next frame."""
        cloud, learned = self._next(frames, sketch, self._background.first)
        for _ in range(PASSES - 1):
            if learned.converged:
                break
            cloud, learned = self._next(frames, sketch, learned)
            if learned.mean is None:        # the candidates explain the frame no better
                break
        return cloud, learned

    def _next(self, frames: Frames, sketch: PhaseSums, learned: BackgroundEstimate
              ) -> tuple[PointCloud, BackgroundEstimate]:
        """A frame's cloud with the background learned from the one before, or a better one; and the next one's."""
        background, candidates = self._background, self._background.candidates(sketch, learned)
        if candidates and frames.surfaces > 1:
            # Further surfaces would be fitted to the background, so one a pixel tells which it is. But dim surfaces
            # that are dropped look uneven, too: the last frame's background is tried beside it.
            _, settled = self._first(frames.with_one_surface, sketch)
            candidates = [learned, candidates[0] if settled.mean is None else settled]
        tried = [(*frames(self._scores, sketch, background.removed(each, sketch)), each)
                 for each in candidates or [learned]]
        cloud, unexplained, removed = min(tried, key=lambda one: one[1].misfit)
        return cloud, background.learned(removed, unexplained)

    @cached_property
    def _pile_up(self) -> PileUp:
        return PileUp(self._matcher)

    @property
    def uneven_background(self) -> float:
        """Mean |β̂_l| of the background that is removed from the next frame; 0 while it is even."""
        mean = self._learned.mean
        return 0.0 if mean is None else float(np.abs(mean).mean())

    def warm_up(self) -> None:
        """Compile the kernels, or load them from the disk, by frames with and without a background.

        A GPU records each kind, for its pixels; on a CPU, few pixels use all kernels.
        """
        sensor, frames = self._matcher.sensor, self._frames
        if frames.device == "cpu":
            sensor = sensor.cropped(slice(8), slice(8))
            frames = Frames(Matcher(sensor, self._matcher.frequencies), "cpu", frames.surfaces)
        sketch = noise_sketch(sensor, self._matcher.frequencies)
        if self._window is not None:
            sketch = replace(sketch, exposure=np.ones(sketch.photons.shape, np.float32))
        uneven = RemovedBackground(sketch.photons.astype(np.float32), np.zeros(len(sketch.frequencies), np.complex64),
                                   np.ones(sensor.num_bins, np.float32))
        frames(self._scores, sketch, ())
        if not self._background.is_even:
            for each, removed in ((frames, uneven), (frames.with_one_surface, ()), (frames.with_one_surface, uneven)):
                each(self._scores, sketch, removed)
        if self._window is not None:
            compile_kernels("move_sketch", "seen_ranges")
