"""A stream of frames by the default method: what `pooled` needs from the frames before."""

from copy import deepcopy
from functools import cached_property

import numpy as np

from srt3d_ros.core.cloud import Estimate, PointCloud
from srt3d_ros.core.devices import kernels_for
from srt3d_ros.core.gpu_check import device_for
from srt3d_ros.core.matched_frame import Matcher
from srt3d_ros.core.method.background import PASSES, Background, BackgroundEstimate
from srt3d_ros.core.method.pile_up import PileUp
from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.sketch import Sketch, noise_sketch
from srt3d_ros.core.thresholds import DEFAULT_FALSE_ALARM_RATE, MAX_FALSE_ALARM_RATE, check_surfaces
from srt3d_ros.errors import require


class PooledStream:
    """Reconstructs frames of one sensor, one after the other; keeps their background and, for a warm start, surfaces.

    Args:
        sensor: geometry, IRF and calibration.
        frequencies: the integers k_l of the sketches.
        surfaces: K, the most surfaces in a pixel, 1 … 4.
        false_alarm_rate: share of the pixels that show a point where there is only background, at most 0.4.
        device: "cpu", "cuda", or "auto": a GPU that has passed `gpu_check`, else the CPU.
        background: how it spreads over the bins: as the "sensor" says, "flat", or "auto": what the last cloud leaves
            unexplained, if that is significant.
        warm_start: begin with the last frame's surfaces where this one's photons still support them, and search for
            the others: less depth error while the scene goes on. For frames that follow each other.

    Attributes:
        device, why: where it computes, and the reason, for people to read.

    Raises:
        InvalidInput: for a parameter that cannot be used.
    """

    def __init__(self, sensor: SensorModel, frequencies, surfaces: int = 1,
                 false_alarm_rate: float = DEFAULT_FALSE_ALARM_RATE, device: str = "auto",
                 background: str = "auto", warm_start: bool = False):
        check_surfaces(surfaces)
        _check_rate(false_alarm_rate)
        self._matcher = Matcher(sensor, frequencies)
        device, self.why = device_for(device, sensor, self._matcher.frequencies, lambda name: PooledStream(
            sensor, frequencies, surfaces, false_alarm_rate, name, background, warm_start))
        self.device, self._kernels = kernels_for(device)
        self.sensor, self.surfaces, self.false_alarm_rate = sensor, surfaces, false_alarm_rate
        self._background = Background(self._matcher, background)
        self._pooled = Pooled(self._matcher, surfaces, false_alarm_rate, self._kernels, not self._background.is_even)
        self._warm_start, self._surfaces, self._is_first = warm_start, None, True

    def __call__(self, sketch: Sketch) -> PointCloud:
        """The point cloud of one frame's sketch.

        A first frame is reconstructed as often as its background takes to settle, at most PASSES times. Each frame
        takes a step towards its background, for the next ones; one that begins to take an uneven background out is
        reconstructed from two starts, and the better is kept. Where the laser cycles are known, pile-up is corrected; a
        first frame then says how much of the light is background, and is reconstructed again.
        """
        self._matcher.check(sketch)
        if not sketch.cycles:
            return PointCloud.of(self._settled(sketch), sketch)
        if self._is_first:
            self._pile_up.forget()
            self._without_pile_up(sketch)
            self.forget()
        return self._without_pile_up(sketch)

    def _without_pile_up(self, sketch: Sketch) -> PointCloud:
        found = self._settled(self._pile_up.without_decay(sketch))
        return self._pile_up.corrected(PointCloud.of(found, sketch), sketch)

    def _settled(self, sketch: Sketch) -> Estimate:
        """The estimate of a frame, of a first one with its background settled."""
        passes, start = PASSES if self._is_first else 1, self._surfaces
        self._is_first = False
        found = self._pass(sketch, start)
        while passes > 1 and not self._background.current.converged:
            passes -= 1
            found = self._pass(sketch)
            if self._background.current.mean is None:        # no start is a background
                break
        return found

    def _pass(self, sketch: Sketch, start: np.ndarray | None = None) -> Estimate:
        """The estimate of least misfit; the surfaces and the background of the next frame become what it shows."""
        starts = self._background.starts(sketch)
        if starts and self.surfaces > 1:        # further surfaces would take the background for themselves
            self._single.forget()
            self._single.allow(self.false_alarm_rate)
            self._single(sketch)
            even = self._single.uneven_background == 0
            starts = starts[:1] if even else (self._single._background.current,)
        if starts:
            tried = [(self._estimate(sketch, None, background), background) for background in starts]
            found, background = min(tried, key=lambda one: one[0].misfit)
        else:
            background = self._background.current
            found = self._estimate(sketch, start, background)
        self._surfaces = found.state
        self._background.learn(background, found)
        return found

    @cached_property
    def _pile_up(self) -> PileUp:
        return PileUp(self._matcher)

    @cached_property
    def _single(self) -> "PooledStream":
        """The same with one surface a pixel."""
        return PooledStream(self.sensor, self._matcher.frequencies, 1, self.false_alarm_rate, self.device)

    def _estimate(self, sketch: Sketch, start: np.ndarray | None, background: BackgroundEstimate) -> Estimate:
        """The estimate with a background; its state is kept for a warm start alone."""
        found = self._pooled(sketch, start, self._background.taken(background, sketch))
        return found._replace(state=deepcopy(found.state) if self._warm_start else None)

    @property
    def uneven_background(self) -> float:
        """Mean |β̂_l| of the background that is taken out of the next frame; 0 while it is even."""
        mean = self._background.current.mean
        return 0.0 if mean is None else float(np.abs(mean).mean())

    def forget(self) -> None:
        """Begin the next frame as if it were the first."""
        self._surfaces, self._is_first = None, True
        self._background.forget()

    def allow(self, false_alarm_rate: float) -> None:
        """Take this rate from the next frame on."""
        _check_rate(false_alarm_rate)
        self.false_alarm_rate = false_alarm_rate
        self._pooled.allow(false_alarm_rate)

    def warm_up(self) -> None:
        """Compile the kernels, or load them from the disk: on a CPU for frames of any size, on a GPU for this one.

        A GPU records each kind of frame that there may be: with and without a background and surfaces to start from.
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
            self._single.warm_up()


def _check_rate(false_alarm_rate: float) -> None:
    require(0 < false_alarm_rate <= MAX_FALSE_ALARM_RATE, "false_alarm_rate", false_alarm_rate,
            f"a probability above 0, at most {MAX_FALSE_ALARM_RATE:g}")
