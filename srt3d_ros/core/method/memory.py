"""PooledStream: frames by the default method, and what it remembers from one to the next."""

from copy import deepcopy
from functools import cached_property

import numpy as np

from srt3d_ros.core.estimate import Estimate
from srt3d_ros.core.matched_frame import Matcher
from srt3d_ros.core.method.background import PASSES, Background, BackgroundEstimate
from srt3d_ros.core.method.pile_up import PileUp
from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.method.thresholds import DEFAULT_FALSE_ALARM_RATE, MAX_FALSE_ALARM_RATE, check_surfaces
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.sums import PhaseSums, noise_sketch
from srt3d_ros.errors import require
from srt3d_ros.kernels.devices import kernels_for


class PooledStream:
    """Reconstructs frames of one sensor in turn; remembers their background and, for a warm start, their surfaces.

    Args:
        sensor: geometry, IRF and calibration.
        frequencies: the integers k_l of the sketches.
        surfaces: K, the most surfaces in a pixel, 1 … 4.
        false_alarm_rate: share of the pixels with background alone that show a point, at most 0.4.
        device: "cpu" or "cuda".
        background: how it spreads over the bins: "sensor": by its background_shape; "flat"; or "auto": what the last
            cloud leaves unexplained, if significant.
        warm_start: begin with the last frame's surfaces where the photons support them: less depth error in a steady
            scene. For consecutive frames.

    Raises:
        InvalidInput: a parameter that cannot be used.
    """

    def __init__(self, sensor: SensorModel, frequencies, surfaces: int = 1,
                 false_alarm_rate: float = DEFAULT_FALSE_ALARM_RATE, device: str = "cpu",
                 background: str = "auto", warm_start: bool = False):
        check_surfaces(surfaces)
        _check_rate(false_alarm_rate)
        self._matcher = Matcher(sensor, frequencies)
        self.device, kernels = kernels_for(device)
        self._kernels = kernels.for_shape(sensor.rows, sensor.cols, surfaces, self._matcher.frequencies)
        self.sensor, self.surfaces, self.false_alarm_rate = sensor, surfaces, false_alarm_rate
        self._background = Background(self._matcher, background)
        self._pooled = Pooled(self._matcher, surfaces, false_alarm_rate, self._kernels, not self._background.is_even)
        self._warm_start, self._surfaces, self._is_first = warm_start, None, True

    def __call__(self, sketch: PhaseSums) -> PointCloud:
        """The point cloud of one frame's sketch.

        Where the laser cycles are known, pile-up is corrected. A first frame is then reconstructed twice: its first
        cloud says how much of the light is background.
        """
        self._matcher.check(sketch)
        if not sketch.cycles:
            return self._cloud(sketch)
        if self._is_first:
            self._pile_up.forget()
            self._without_pile_up(sketch)
            self.forget()
        return self._without_pile_up(sketch)

    def _without_pile_up(self, sketch: PhaseSums) -> PointCloud:
        return self._pile_up.corrected(self._cloud(self._pile_up.without_decay(sketch)), sketch)

    def _cloud(self, sketch: PhaseSums) -> PointCloud:
        """The cloud of a frame; a first one is repeated until its background has converged, at most PASSES times."""
        passes, start = (PASSES, None) if self._is_first else (1, self._surfaces)
        self._is_first = False
        found = self._estimate(sketch, start)
        for _ in range(passes - 1):
            if self._background.current.converged:
                break
            found = self._estimate(sketch)
            if self._background.current.mean is None:       # the candidates explain the frame no better
                break
        return PointCloud.of(found, self.sensor, sketch.stamp_ns)

    def _estimate(self, sketch: PhaseSums, start: np.ndarray | None = None) -> Estimate:
        """The estimate of least misfit. Surfaces and background of the next frame become what it shows."""
        candidates = self._candidates(sketch)
        if candidates:
            tried = [(self._with_background(each, sketch), each) for each in candidates]
            found, background = min(tried, key=lambda one: one[0].unexplained.misfit)
        else:
            background = self._background.current
            found = self._with_background(background, sketch, start)
        self._surfaces = found.state
        self._background.learn(background, found)
        return found

    def _with_background(self, background: BackgroundEstimate, sketch: PhaseSums, start: np.ndarray | None = None
                         ) -> Estimate:
        """The estimate with a background. For a warm start its state is copied: the next call overwrites it."""
        found = self._pooled(sketch, start, self._background.taken(background, sketch))
        return found._replace(state=deepcopy(found.state) if self._warm_start else None)

    def _candidates(self, sketch: PhaseSums) -> tuple[BackgroundEstimate, ...]:
        """The backgrounds to try on a frame that seems to have an uneven one; none if the current one is used."""
        candidates = self._background.candidates(sketch)
        if not candidates or self.surfaces == 1:
            return candidates
        # Further surfaces would be fitted to the background, so one surface a pixel decides on it.
        settled = self._one_surface.background_of(sketch, self.false_alarm_rate)
        return candidates[:1] if settled.mean is None else (settled,)

    def background_of(self, sketch: PhaseSums, false_alarm_rate: float) -> BackgroundEstimate:
        """The background that a first frame converges to."""
        self.forget()
        self.set_false_alarm_rate(false_alarm_rate)
        self._cloud(sketch)
        return self._background.current

    @cached_property
    def _pile_up(self) -> PileUp:
        return PileUp(self._matcher)

    @cached_property
    def _one_surface(self) -> "PooledStream":
        """The same with one surface a pixel."""
        return PooledStream(self.sensor, self._matcher.frequencies, 1, self.false_alarm_rate, self.device)

    @property
    def uneven_background(self) -> float:
        """Mean |β̂_l| of the background that is removed from the next frame; 0 while it is even."""
        mean = self._background.current.mean
        return 0.0 if mean is None else float(np.abs(mean).mean())

    def forget(self) -> None:
        """Begin the next frame as if it were the first."""
        self._surfaces, self._is_first = None, True
        self._background.forget()

    def set_false_alarm_rate(self, false_alarm_rate: float) -> None:
        """Use this false alarm rate from the next frame on."""
        _check_rate(false_alarm_rate)
        self.false_alarm_rate = false_alarm_rate
        self._pooled.set_false_alarm_rate(false_alarm_rate)

    def warm_up(self) -> None:
        """Compile the kernels, or load them from the disk: on a CPU for frames of any size, on a GPU for this one.

        A GPU records each kind of frame: with and without a background, and with and without a start.
        """
        self._kernels.load()
        if self._kernels.ON_HOST:
            sensor = self.sensor.cropped(slice(8), slice(8))
            PooledStream(sensor, self._matcher.frequencies, self.surfaces, device=self.device)(
                noise_sketch(sensor, self._matcher.frequencies))
            return
        sketch = noise_sketch(self.sensor, self._matcher.frequencies)
        some = (sketch.photons.astype(np.float32), np.zeros(len(sketch.frequencies), np.complex64),
                np.ones(self.sensor.num_bins, np.float32))
        for background in ((),) if self._background.is_even else ((), some):
            found = self._pooled(sketch, None, background)
            if self._warm_start:
                self._pooled(sketch, deepcopy(found.state), background)
        if self.surfaces > 1 and not self._background.is_even:
            self._one_surface.warm_up()


def _check_rate(false_alarm_rate: float) -> None:
    require(0 < false_alarm_rate <= MAX_FALSE_ALARM_RATE, "false_alarm_rate", false_alarm_rate,
            f"a probability above 0, at most {MAX_FALSE_ALARM_RATE:g}")
