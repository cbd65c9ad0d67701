"""Pooled: one frame of the default method: the paper's data term, pooled along surfaces (docs/algorithm.md).

    J. Tachella, M. P. Sheehan, M. E. Davies, "Sketched RT3D: how to reconstruct billions of photons per second",
    ICASSP 2022.

As in the paper, Gauss-Newton steps on the depth t and the intensity r of every point alternate with a step that creates
and removes points. The paper then smooths depths with a denoiser. Here a point climbs the sum of the data terms of the
pixels around it instead, each weighted by how surely it sees the same surface: photons are shared, not depths.
`core.baselines.sketched.SRT3D` is the paper's method, step by step.
"""

from math import ceil

import numpy as np

from srt3d_ros.core.estimate import Estimate, Unexplained
from srt3d_ros.core.matched_frame import MatchedFrame, Matcher
from srt3d_ros.core.method.thresholds import continuation_threshold, score_threshold
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.kernels import constants, maps

STAYING = 0.5           # share of false points that survive the iterations (`python -m benchmarks false_alarms`)


class Pooled:
    """Reconstructs one frame from its sketch, a start and a background; keeps nothing from frame to frame.

    Args:
        matcher: of the sensor and the frequencies.
        surfaces: K, the most surfaces in a pixel.
        false_alarm_rate: of `memory.PooledStream`.
        kernels: of the device.
        explains: fill `Estimate.unexplained`.
    """

    def __init__(self, matcher: Matcher, surfaces: int, false_alarm_rate: float, kernels, explains: bool):
        sensor, array = matcher.sensor, kernels.array
        self._sensor, self._surfaces, self._kernels, self._explains = sensor, surfaces, kernels, explains
        self._matched, self._highest = matcher.on(kernels), max(matcher.frequencies)
        self._equaliser, self._passed, self._used, self._rays = map(array, (
            matcher.equaliser, matcher.passed, matcher.used, sensor.rays))
        # On a GPU an even background has a clutter of ones, so that each step is compiled once, not twice.
        self._even = None if kernels.ON_HOST else array(np.ones(sensor.num_bins, np.float32))
        self._run = kernels.recorded(self._estimate)
        self.set_false_alarm_rate(false_alarm_rate)

    def set_false_alarm_rate(self, false_alarm_rate: float) -> None:
        """Use this false alarm rate from the next frame on."""
        started = false_alarm_rate / STAYING
        found = score_threshold(started, self._highest, constants.WIDE_SCALE)
        self._enough = np.array([score_threshold(started, self._highest), found, max(found, constants.START_SCORE),
                                 continuation_threshold(started)], np.float32)

    def __call__(self, sketch: PhaseSums, start: np.ndarray | None = None, background: tuple = ()) -> Estimate:
        """The estimate of a frame.

        Args:
            start: `Estimate.state` of the frame before; None to begin with no surface.
            background: of `background.Background.taken`.
        """
        photons, kernels = sketch.photons.astype(np.float32), self._kernels
        state, left, rest, background, *points = self._run(photons, sketch.sums, start, self._enough, *background)
        unexplained = Unexplained.unpacked(kernels.numpy(left)) if self._explains else None
        return Estimate(state, unexplained, kernels.numpy(rest), kernels.numpy(background), *kernels.unpack(*points))

    def _estimate(self, photons, sums, start, enough, background=None, mean=None, clutter=None) -> tuple:
        kernels, (weak, found, further, continued) = self._kernels, enough

        # Match: remove delay, IRF and background from each pixel's sketch.
        taken = None if background is None else kernels.local_mean(background, self._used)
        matched, counts = kernels.prepare(sums, photons, self._equaliser, self._used, taken, self._passed, mean)
        frame = self._matched(matched, counts, self._even if clutter is None else clutter)

        # Start with sure surfaces, let them spread, and search the pixels without one in wider windows.
        state = kernels.no_surfaces(frame, self._surfaces)
        sure = constants.START_SCORE
        self._search(frame, state, constants.START_SCALES, sure, sure, start, continued)
        state = self._iterate(frame, state, *constants.WINDOWS[0], constants.FIRST_STEPS)
        kernels.drop_weak(state, weak)
        self._search(frame, state, (constants.WIDE_SCALE,), found, further)

        # Iterate over wider windows.
        for sigma, fine in constants.WINDOWS[1:]:
            state = self._iterate(frame, state, sigma, fine)

        # Finish: outlines, threshold, intensities, standard deviations, points.
        terms = kernels.expand(frame, state)
        kernels.trim(frame, state, terms, continued)
        points, rest, background = kernels.finalise(frame, photons, state, terms, continued)
        left = kernels.unexplained(frame, points, rest, taken, self._passed) if self._explains else rest[:0, 0]
        view = maps.crop(points, *frame.shape)
        return state, left, rest, background, *kernels.collect(
            view[:, :, maps.DEPTH], view[:, :, maps.INTENSITY], view[:, :, maps.STD], self._rays,
            self._sensor.bin_width_m, float(self._sensor.range_m(0)), self._sensor.num_bins)

    def _search(self, frame: MatchedFrame, state, scales, enough, further, start=None, confirmed=0.0) -> None:
        """Search by matched filters on sketches pooled at growing scales; a pixel takes the first sure surface.

        Each scale pools the pixels that are still open. A first surface needs a score of `enough` at the last scale and
        of `further` before. Further surfaces, in what the former ones leave unexplained, need `further`; those of
        `start` need `confirmed`.
        """
        kernels = self._kernels
        for layer in range(self._surfaces):
            terms = kernels.expand(frame, state) if layer > 0 else None
            matched = kernels.residual(frame, state, terms, layer) if layer > 0 else frame.matched
            for sigma in scales:
                least = enough if sigma == scales[-1] and layer == 0 else further
                slanted = sigma in constants.START_SCALES[1:] and layer == 0 and start is None
                kernels.search(frame, matched, state, layer, sigma, constants.cell_size(sigma), least, start, confirmed,
                               slanted)

    def _iterate(self, frame: MatchedFrame, state, sigma: float, fine: int, steps: int = 1):
        """Birth and death of points, then Gauss-Newton steps on the data terms pooled over the window."""
        kernels, radius = self._kernels, ceil(constants.REACH * sigma)
        state = kernels.birth_death(frame, state, kernels.expand(frame, state), constants.SAME_SURFACE**2)
        for _ in range(steps):
            terms = kernels.expand(frame, state)
            state = kernels.pooled_step(frame, state, terms, sigma, radius, fine, constants.SAME_SURFACE**2)
        return state
