"""Pooled: the default method, the paper's data term pooled along surfaces (docs/algorithm.md).

    J. Tachella, M. P. Sheehan, M. E. Davies, "Sketched RT3D: how to reconstruct billions of photons per second",
    ICASSP 2022.

As in the paper, Gauss-Newton steps on the depth t and the intensity r of every point alternate with a step that creates
and removes points. The paper then smooths depths with a denoiser. Here a point climbs the sum of the data terms of the
pixels around it instead, each weighted by how surely it sees the same surface: photons are shared, not depths.
`core.baselines.sketched.SRT3D` is the paper's method, step by step.
"""

from copy import deepcopy
from functools import cached_property, partial
from math import ceil

import numpy as np

from srt3d_ros.core.matched_frame import Matcher, SensorOnDevice
from srt3d_ros.core.method.background import Background, RemovedBackground
from srt3d_ros.core.method.convergence import Convergence
from srt3d_ros.core.method.found import Found, Unexplained
from srt3d_ros.core.method.pile_up import PileUp
from srt3d_ros.core.method.thresholds import DEFAULT_FALSE_ALARM_RATE, Scores
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.sums import PhaseSums, noise_sketch
from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import (
    REACH,
    SAME_SURFACE,
    START_SCALES,
    START_SCORE,
    WIDE_SCALE,
    WINDOWS,
    Window,
    cell_size,
)
from srt3d_ros.kernels.contract import Kernels
from srt3d_ros.kernels.devices import kernels_for
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, STD


def frame(kernels: Kernels, sensor: SensorOnDevice, surfaces: int, explains: bool, photons, sums, start, scores,
          *background) -> tuple:
    """One frame, from arrays on the device to arrays on the device.

    Args:
        photons, sums: of the sketch.
        start: the points of the frame before, or None.
        scores: a `Scores`.
        background: a `RemovedBackground`, or nothing for an even one.

    Returns:
        The points, float32 [rows', K, FIELDS, cols'] (`kernels.maps`), for the next start; for `Unexplained`, if
        `explains`; photons that are not the points', and background photons, float32 [rows, cols]; the list of points.
    """
    scores = Scores(*scores)
    data, taken = sensor.match(photons, sums, *background)
    points = kernels.no_surfaces(data, surfaces)
    search(kernels, data, points, START_SCALES, START_SCORE, START_SCORE, start, scores.keep)
    points = iterate(kernels, data, points, WINDOWS[0])
    kernels.drop_weak(points, scores.drop)
    search(kernels, data, points, (WIDE_SCALE,), scores.find, scores.further)
    for window in WINDOWS[1:]:
        points = iterate(kernels, data, points, window)
    terms = kernels.expand(data, points)
    kernels.trim(data, points, terms, scores.keep)
    final, rest, background = kernels.finalise(data, photons, points, terms, scores.keep)
    left = kernels.unexplained(data, final, rest, taken, sensor.passed) if explains else None
    view = maps.crop(final, *data.shape)
    return points, left, rest, background, *sensor.listed(*(view[:, :, field] for field in (DEPTH, INTENSITY, STD)))


def search(kernels: Kernels, data, points, scales, enough, further, start=None, confirmed=0.0) -> None:
    """Search by matched filters on sketches pooled at growing scales; a pixel takes the first sure surface.

    Each scale pools the pixels that are still open. A first surface needs a score of `enough` at the last scale and of
    `further` before. Further surfaces, in what the former ones leave unexplained, need `further`; those of `start`
    need `confirmed`.
    """
    for layer in range(points.shape[1]):
        is_first = layer == 0
        matched = data.matched if is_first else kernels.residual(data, points, kernels.expand(data, points), layer)
        for sigma in scales:
            least = enough if is_first and sigma == scales[-1] else further
            slanted = is_first and start is None and sigma in START_SCALES[1:]
            kernels.search(data, matched, points, layer, sigma, cell_size(sigma), least, start, confirmed, slanted)


def iterate(kernels: Kernels, data, points, window: Window):
    """Birth and death of points, then Gauss-Newton steps on the data terms pooled over the window."""
    points, terms = kernels.birth_death(data, points, kernels.expand(data, points), SAME_SURFACE**2)
    radius = ceil(REACH * window.sigma)
    for step in range(window.steps):
        if step > 0:
            terms = kernels.expand(data, points)
        points = kernels.pooled_step(data, points, terms, window.sigma, radius, window.fine, SAME_SURFACE**2)
    return points


class Frames:
    """Runs `frame` on a device for sketches of one sensor; keeps nothing from frame to frame.

    Args:
        surfaces: K, the most surfaces in a pixel.
        explains: fill `Found.unexplained`.
    """

    def __init__(self, matcher: Matcher, device: str, surfaces: int, explains: bool = True):
        sensor = matcher.sensor
        self.kernels = kernels_for(device).for_shape(sensor.rows, sensor.cols, surfaces, matcher.frequencies)
        self._sensor = matcher.on(self.kernels)
        self.run = self.kernels.as_frame(partial(frame, self.kernels, self._sensor, surfaces, explains))

    def __call__(self, scores: Scores, sketch: PhaseSums, removed: tuple, start=None) -> Found:
        """The points of a sketch; `removed` is a `RemovedBackground`, or () for an even background."""
        points, left, rest, background, *listed = self.run(
            sketch.photons.astype(np.float32), sketch.sums, start, np.array(scores, np.float32), *removed)
        unexplained = None if left is None else Unexplained.unpacked(self.kernels.numpy(left))
        cloud = self._sensor.cloud(listed, background, sketch.stamp_ns)
        return Found(cloud, self.kernels.numpy(rest), unexplained, points)


class Pooled:
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
                 false_alarm_rate: float = DEFAULT_FALSE_ALARM_RATE, device: str = "cpu", background: str = "auto",
                 warm_start: bool = False):
        self.sensor, self.surfaces, self.device, self._warm_start = sensor, surfaces, device, warm_start
        self._matcher = Matcher(sensor, frequencies)
        self._background = Background(self._matcher, background)
        self._frames = Frames(self._matcher, device, surfaces, not self._background.is_even)
        one_surface = None if surfaces == 1 else Convergence(self._background, self._with_one_surface)
        self._reconstruct = Convergence(self._background, partial(self._found, self._frames), one_surface)
        self.set_false_alarm_rate(false_alarm_rate)
        self.forget()

    def forget(self) -> None:
        """Begin the next frame as if it were the first."""
        self._learned, self._points, self._background_share = None, None, 1.0

    def set_false_alarm_rate(self, false_alarm_rate: float) -> None:
        """Use this false alarm rate from the next frame on."""
        self._scores = Scores.of(false_alarm_rate, max(self._matcher.frequencies))

    def __call__(self, sketch: PhaseSums) -> PointCloud:
        """The point cloud of one frame's sketch; where the laser cycles are known, pile-up is corrected."""
        self._matcher.check(sketch)
        is_first = self._learned is None
        cloud = self._cloud(sketch, is_first)
        if is_first and sketch.cycles:      # again: its first cloud says how much of the light is background
            cloud = self._cloud(sketch, is_first)
        return cloud

    def _cloud(self, sketch: PhaseSums, is_first: bool) -> PointCloud:
        """The cloud of a frame; the next one starts from its background, its surfaces and its background's share."""
        seen = self._pile_up.without_decay(sketch, self._background_share) if sketch.cycles else sketch
        found, self._learned = self._reconstruct.first(seen) if is_first else self._reconstruct.next(
            seen, self._learned, self._points)
        self._points = found.points
        if not sketch.cycles:
            return found.cloud
        cloud, self._background_share = self._pile_up.corrected(found.cloud, sketch)
        return cloud

    def _found(self, frames: Frames, *arguments) -> Found:
        """What a frame shows. Points for a warm start are copied: the next call overwrites them."""
        found = frames(self._scores, *arguments)
        return found._replace(points=deepcopy(found.points) if self._warm_start else None)

    def _with_one_surface(self, *arguments) -> Found:
        return self._found(self._one_surface, *arguments)

    @cached_property
    def _one_surface(self) -> Frames:
        return Frames(self._matcher, self.device, 1)

    @cached_property
    def _pile_up(self) -> PileUp:
        return PileUp(self._matcher)

    @property
    def uneven_background(self) -> float:
        """Mean |β̂_l| of the background that is removed from the next frame; 0 while it is even."""
        mean = (self._learned or self._background.first).mean
        return 0.0 if mean is None else float(np.abs(mean).mean())

    def warm_up(self) -> None:
        """Compile the kernels, or load them from the disk, by frames of each kind.

        On a CPU, few pixels with any number of surfaces use all of them. A GPU records frames with and without a
        background, and a start.
        """
        is_even, matcher = self._background.is_even, self._matcher
        if self.device == "cpu":
            matcher = Matcher(self.sensor.cropped(slice(8), slice(8)), matcher.frequencies)
            several = [Frames(matcher, self.device, self.surfaces, not is_even)]
        else:
            several = [self._frames] if self.surfaces == 1 or is_even else [self._frames, self._one_surface]
        sketch = noise_sketch(matcher.sensor, matcher.frequencies)
        uneven = RemovedBackground(sketch.photons.astype(np.float32), np.zeros(len(matcher.frequencies), np.complex64),
                                   np.ones(self.sensor.num_bins, np.float32))
        for frames in several:
            for removed in ((),) if is_even else ((), uneven):
                start = frames(self._scores, sketch, removed).points
                if self._warm_start:
                    frames(self._scores, sketch, removed, deepcopy(start))
