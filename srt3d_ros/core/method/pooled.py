"""One frame of the default method: the paper's data term, pooled along surfaces. docs/algorithm.md has the equation.

    J. Tachella, M. P. Sheehan, M. E. Davies, "Sketched RT3D: how to reconstruct billions of photons per second",
    ICASSP 2022.

Like the paper's, it takes Gauss-Newton steps on the depth t and the intensity r of every point, in turn with a step
that creates and removes points. Unlike the paper's denoiser, which smooths depths, a point here climbs the sum of the
data terms of the pixels around it, each weighted by how surely it sees the same surface: photons are shared, not
depths. `core.baselines.sketched.SRT3D` is the paper's own, step by step.
"""

from functools import partial
from math import ceil

import numpy as np

from srt3d_ros.core.method.cloud import Estimate
from srt3d_ros.core.method.matched_frame import MatchedFrame, Matcher
from srt3d_ros.core.method.thresholds import continuation_threshold, score_threshold
from srt3d_ros.core.sketching.sketch import Sketch
from srt3d_ros.kernels import constants, maps
from srt3d_ros.kernels.finalise import LOCAL_WEIGHTS, finalise

STAYING = 0.5           # share of false points that the iterations leave (`python -m benchmarks false_alarms`)


class Pooled:
    """A sketch, a start and a background in, an estimate out: nothing is kept from frame to frame.

    Args:
        matcher: of the sensor and the frequencies.
        surfaces: K, the most surfaces in a pixel.
        false_alarm_rate: of `memory.PooledStream`.
        kernels: where it computes.
        explains: whether to add up what the points leave unexplained.
    """

    def __init__(self, matcher: Matcher, surfaces: int, false_alarm_rate: float, kernels, explains: bool):
        sensor, array = matcher.sensor, kernels.array
        self._sensor, self._surfaces, self._kernels = sensor, surfaces, kernels
        self._matched = matcher.padded_on(kernels)
        started = false_alarm_rate / STAYING
        highest = max(matcher.frequencies)
        self._weak = score_threshold(started, highest)
        self._found = score_threshold(started, highest, constants.WIDE_SCALE)
        self._continued, self._explains = continuation_threshold(started), explains
        self._equaliser, self._passed, self._used, self._rays = map(array, (
            matcher.equaliser, matcher.passed, matcher.used, sensor.rays))
        self._near = self._used / kernels.blur((self._used + 1e-6)[:, None], LOCAL_WEIGHTS)[:, 0]

    def __call__(self, sketch: Sketch, start: np.ndarray | None = None, background: tuple = ()) -> Estimate:
        """The estimate of a frame.

        Args:
            start: `Estimate.state` of the frame before; None to begin with no surface.
            background: of `background.Background.taken`.
        """
        step, photons = partial(self._estimate, start), sketch.photons.astype(np.float32)
        return Estimate(*self._kernels.run_frame(step, photons, sketch.sums, *background))

    def _estimate(self, start, photons, sums, background=None, mean=None, clutter=None) -> tuple:
        kernels, found, continued = self._kernels, self._found, self._continued

        # Match: take delay, gain, IRF and known background out of each pixel's sketch.
        taken = None if background is None else self._averaged(background * self._used)
        shown = None if mean is None else self._passed * mean
        frame = self._matched(*kernels.prepare(sums, photons, self._equaliser, self._used, taken, shown), clutter)

        # Start with surfaces that are sure, let them spread, and search the pixels that are still open more widely.
        state = kernels.no_surfaces(frame, self._surfaces)
        self._search(frame, state, constants.START_SCALES, constants.START_SCORE, start, continued)
        state = self._iterate(frame, state, *constants.WINDOWS[0], constants.FIRST_STEPS)
        state[:, :, maps.INTENSITY] *= state[:, :, maps.SCORE] >= self._weak
        self._search(frame, state, (constants.WIDE_SCALE,), found)

        # Iterate over wider windows.
        for sigma, fine in constants.WINDOWS[1:]:
            state = self._iterate(frame, state, sigma, fine)

        # Finish: outlines, threshold, intensities, standard deviations, points.
        terms = kernels.expand(frame, state)
        kernels.trim(frame, state, terms, continued)
        intensity, std, background = finalise(kernels, frame, photons, state, terms, continued)
        left = self._left(frame, state, intensity, background, taken) if self._explains else background[:0, 0]
        return state, left, background, *kernels.collect(
            state, intensity, std, self._rays, self._sensor.bin_width_m, float(self._sensor.range_m(0)),
            self._sensor.num_bins)

    def _search(self, frame: MatchedFrame, state, scales, enough: float, start=None, confirmed: float = 0.0) -> None:
        """Matched filter on sketches pooled at growing scales; the first scale at which a pixel is sure decides.

        A scale pools the pixels that are still open. At the last one a score of `enough` decides. Further surfaces are
        searched for in what those before leave unexplained; only sure ones count. Those of `start` need `confirmed`.
        """
        kernels = self._kernels
        for layer in range(self._surfaces):
            terms = kernels.expand(frame, state) if layer > 0 else None
            matched = kernels.residual(frame, state, terms, layer) if layer > 0 else frame.matched
            for sigma in scales:
                least = enough if sigma == scales[-1] and layer == 0 else max(constants.START_SCORE, enough)
                slanted = sigma == constants.SLANTED_SCALE and layer == 0 and start is None
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

    def _left(self, frame: MatchedFrame, state, intensity, background, taken):
        """What the points leave unexplained."""
        own, seen = background * self._used, maps.crop(frame.counts, *frame.shape) * self._used
        return self._kernels.unexplained(frame, state, intensity, own, own if taken is None else taken,
                                         self._averaged(own), self._averaged(seen), self._passed)

    def _averaged(self, values):
        """Local means, as in `finalise`, of an array [rows, cols] on the device that is 0 where masked."""
        return self._kernels.blur(values[:, None], LOCAL_WEIGHTS)[:, 0] * self._near
