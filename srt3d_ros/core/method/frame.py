"""One frame by the default method, from sketch to points: docs/algorithm.md, "Steps".

Nothing is kept from frame to frame. `frame` gets and gives arrays on the device and branches on none of their values,
so that a GPU can record it.
"""

from functools import cached_property, partial
from math import ceil

import numpy as np

from srt3d_ros.core.method.background import RemovedBackground, Unexplained
from srt3d_ros.core.method.matched_frame import MatchedFrame, Matcher, SensorOnDevice
from srt3d_ros.core.method.thresholds import Scores
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sketching.sums import PhaseSums
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
from srt3d_ros.kernels.contract import Array, Kernels
from srt3d_ros.kernels.maps import DEPTH, INTENSITY, STD


def frame(sensor: SensorOnDevice, surfaces: int, photons: Array, sums: Array, exposure: Array | None,
          thresholds: Array, *removed: Array) -> tuple:
    """One frame on the device.

    Args:
        photons, sums: of the sketch.
        exposure: of the MatchedFrame, or None: the sensor's.
        thresholds: a `Scores`.
        removed: a `RemovedBackground`, or nothing for an even one.

    Returns:
        For `Unexplained`; photons that are not the points', and background photons, float32 [rows, cols]; the list of
        points.
    """
    kernels, scores = sensor.kernels, Scores(*thresholds)
    data, taken = sensor.match(photons, sums, exposure, *removed)
    points = kernels.no_surfaces(data, surfaces)
    search(kernels, data, points, START_SCALES, START_SCORE, START_SCORE)
    kernels.turn_planes(data, points)
    points = iterate(kernels, data, points, WINDOWS[0])
    kernels.drop_weak(points, scores.drop)
    search(kernels, data, points, (WIDE_SCALE,), scores.find, scores.further)
    for window in WINDOWS[1:]:
        points = iterate(kernels, data, points, window)
    kernels.drop_ghosts(data, points)
    terms = kernels.expand(data, points)
    kernels.trim(data, points, terms, scores.keep)
    kernels.drop_blobs(data, points, scores.whole)
    final, rest, background = kernels.finalise(data, photons, points, terms, scores.keep)
    left = kernels.unexplained(data, final, rest, taken, sensor.passed)
    shown = maps.crop(final, *data.shape)
    return left, rest, background, *sensor.listed(shown[:, :, DEPTH], shown[:, :, INTENSITY], shown[:, :, STD])


def search(kernels: Kernels, data: MatchedFrame, points: Array, scales: tuple[float, ...], enough: float,
           further: float) -> None:
    """Search by matched filters on sketches pooled at growing scales; a pixel takes the first sure surface.

    Each scale pools the pixels that are still open. A first surface needs a score of `enough` at the last scale and of
    `further` before. Further surfaces, in what the former ones leave unexplained, need `further`.
    """
    for layer in range(points.shape[1]):
        is_first = layer == 0
        matched = data.matched if is_first else kernels.residual(data, points, kernels.expand(data, points), layer)
        for sigma in scales:
            least = enough if is_first and sigma == scales[-1] else further
            slanted = is_first and sigma in START_SCALES[1:]
            kernels.search(data, matched, points, layer, sigma, cell_size(sigma), least, slanted)
        kernels.drop_ghosts(data, points)


def iterate(kernels: Kernels, data: MatchedFrame, points: Array, window: Window) -> Array:
    """Birth and death of points, then Gauss-Newton steps on the data terms pooled over the window."""
    points, terms = kernels.birth_death(data, points, kernels.expand(data, points), SAME_SURFACE**2)
    radius = ceil(REACH * window.sigma)
    for step in range(window.steps):
        if step > 0:
            terms = kernels.expand(data, points)
        points = kernels.pooled_step(data, points, terms, window.sigma, radius, window.fine, SAME_SURFACE**2)
    return points


class Frames:
    """Runs `frame` on a device for sketches of one sensor.

    Args:
        surfaces: K, the most surfaces in a pixel.
    """

    def __init__(self, matcher: Matcher, device: str, surfaces: int):
        self.matcher, self.device, self.surfaces = matcher, device, surfaces
        self._sensor = SensorOnDevice(matcher, device, surfaces)
        self.kernels = self._sensor.kernels
        self.run = self.kernels.as_frame(partial(frame, self._sensor, surfaces))

    def __call__(self, scores: Scores, sketch: PhaseSums, removed: RemovedBackground | tuple[()]
                 ) -> tuple[PointCloud, Unexplained]:
        """What a sketch shows, and what that leaves unexplained; `removed` is () for an even background."""
        exposure = None if sketch.exposure is None else maps.pad(self.matcher.sensor.exposure * sketch.exposure)
        left, rest, background, *listed = self.run(
            sketch.photons.astype(np.float32), sketch.sums, exposure, np.array(scores, np.float32), *removed)
        unexplained = Unexplained.unpacked(self.kernels.numpy(rest) / sketch.frames, self.kernels.numpy(left))
        return self._sensor.cloud(listed, background, sketch), unexplained

    @cached_property
    def with_one_surface(self) -> "Frames":
        """The same with one surface a pixel."""
        return self if self.surfaces == 1 else Frames(self.matcher, self.device, 1)
