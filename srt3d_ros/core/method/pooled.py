"""The default method: the paper's data term, pooled along surfaces. docs/algorithm.md explains it beside the paper.

    J. Tachella, M. P. Sheehan, M. E. Davies, "Sketched RT3D: how to reconstruct billions of photons per second",
    ICASSP 2022.

It minimises the paper's Σ_ij n_ij ‖z_ij − Ψ_θij‖² + ρ(θ), with Ψ_θ(ω) = Σ_k α_k ĥ(ω) exp(i ω t_k), by Gauss-Newton
steps on depth t and intensity r = n α, a threshold on the evidence for each point, and a denoiser that also creates and
removes points. Here the denoiser acts on the data term: those of the pixels around a point add up along its tangent
plane, each weighted by how surely its pixel sees the same surface. So photons are shared, not depths. Where photons are
plenty the depths are known so well that the weights end at the finest relief; where they are few a point borrows from
the whole window.
"""

from functools import partial

import numpy as np

from srt3d_ros.core.device import kernels_for
from srt3d_ros.core.method.background import PASSES, WINDOW, Background, Belief
from srt3d_ros.core.method.cloud import PointCloud
from srt3d_ros.core.method.gpu_check import device_for
from srt3d_ros.core.method.matched_frame import MatchedFrame, Matcher
from srt3d_ros.core.method.thresholds import continuation_threshold, score_threshold
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.sketch import Sketch, noise_sketch
from srt3d_ros.errors import require
from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import (
    FIRST_STEPS,
    REST_SCALES,
    SAME_SURFACE,
    SLANTED,
    SLANTS,
    SURE,
    SURE_SCALES,
    SURE_SLANTED,
    WEAK,
    WINDOWS,
)

DEFAULT_FALSE_ALARM_RATE = 1e-4
MAX_SURFACES = 4
TINY = 1e-9


class Pooled:
    """Reconstructs frames of one sensor, one after the other: its memory stays from frame to frame.

    Args:
        sensor: geometry, IRF and calibration.
        frequencies: the integers k_l of the sketches.
        surfaces: K, the most surfaces in a pixel, 1 … 4.
        false_alarm_rate: probability that a pixel that sees only background shows a point, before its neighbours vote.
        device: "cpu", "cuda", or "auto": a GPU that has passed `gpu_check`, else the CPU.
        background: how it spreads over the bins: as the "sensor" says, "flat", or "auto": what the last cloud leaves
            unexplained, if that is significant.
        warm_start: begin with the last frame's surfaces where this one's photons still support them, and search for
            the others: less depth error while the scene goes on. For frames that follow each other.

    Raises:
        InvalidInput: for a parameter that cannot be used.
    """

    def __init__(self, sensor: SensorModel, frequencies, surfaces: int = 1,
                 false_alarm_rate: float = DEFAULT_FALSE_ALARM_RATE, device: str = "auto",
                 background: str = "auto", warm_start: bool = False):
        check_options(surfaces, false_alarm_rate)
        self._matcher = Matcher(sensor, frequencies)
        if device == "auto":
            device = device_for(sensor, self._matcher.frequencies, lambda name: Pooled(
                sensor, frequencies, surfaces, false_alarm_rate, name, background, warm_start))
        self.device, self.kernels = kernels_for(device)
        self.sensor, self.surfaces, self.false_alarm_rate = sensor, surfaces, false_alarm_rate
        self._background = Background(self._matcher, background)
        array = self.kernels.array
        self._padded = self._matcher.padded_on(self.kernels)
        self._equaliser, self._passed, self._used, self._rays = map(array, (
            self._matcher.equaliser, self._matcher.passed, self._matcher.used, sensor.rays))
        self._square = np.ones(WINDOW, np.float32)
        self._near = self._used / self._sums_near(self._used + 1e-6)
        self._scratch = self.kernels.Scratch()
        self._warm_start, self._next_is_warm, self._is_first = warm_start, False, True
        self._added_variance = 0.0

    def __call__(self, sketch: Sketch) -> PointCloud:
        """The point cloud of one frame's sketch.

        A first frame is reconstructed as often as its background takes to settle, at most PASSES times. Each frame
        takes a step towards its background, for the next ones; one that begins to take an uneven background out is
        reconstructed from two starts, and the better is kept.
        """
        self._matcher.check(sketch)
        self._added_variance = sketch.added_variance
        passes, warm = PASSES if self._is_first else 1, self._next_is_warm
        self._is_first, self._next_is_warm = False, self._warm_start
        cloud = self._pass(sketch, warm)
        while passes > 1 and not self._background.belief.settled:
            passes -= 1
            cloud = self._pass(sketch, warm=False)
            if self._background.belief.mean is None:        # no start is a background
                break
        return cloud

    def _pass(self, sketch: Sketch, warm: bool) -> PointCloud:
        """A cloud with the background in force, which learns from it."""
        starts = self._background.starts(sketch)
        if not starts:
            cloud, self._background.belief, _ = self._reconstruct(sketch, self._background.belief, warm)
            return cloud
        if self.surfaces > 1:           # further surfaces would take the background for themselves
            single = Pooled(self.sensor, self._matcher.frequencies, 1, self.false_alarm_rate, self.device)
            single(sketch)
            starts = starts[:1] if single.uneven_background == 0 else (single._background.belief,)
        cloud, self._background.belief, _ = min((self._reconstruct(sketch, start, warm=False) for start in starts),
                                                key=lambda found: found[-1])
        return cloud

    def _reconstruct(self, sketch: Sketch, belief: Belief, warm: bool) -> tuple[PointCloud, Belief, float]:
        """Cloud, the belief after it, and its misfit."""
        found, *points = self.kernels.run_frame(partial(self._points, warm), sketch.photons, sketch.sums,
                                                *self._background.taken(belief, sketch))
        after = belief if self._background.is_even else self._background.learn(belief, found, points[0])
        return self._cloud(sketch.stamp_ns, *points), after, found[-1]

    @property
    def uneven_background(self) -> float:
        """Mean |β̂_l| of the background that is taken out of the next frame; 0 while it is even."""
        mean = self._background.belief.mean
        return 0.0 if mean is None else float(np.abs(mean).mean())

    def forget(self) -> None:
        """Begin the next frame as if it were the first."""
        self._next_is_warm, self._is_first = False, True
        self._background.forget()

    def _sums_near(self, values):
        """Sums over the square around each pixel, of an array [rows, cols] on the device."""
        return self.kernels.blur(values[:, None], self._square)[:, 0]

    def _points(self, warm: bool, photons, sums, background=None, mean=None, clutter=None) -> tuple:
        """What `unexplained` finds, background and points of a frame, from its photons and sums.

        Args:
            background, mean: photons that are taken out of the frame, and β̂; None for none.
            clutter: `MatchedFrame.clutter`.
        """
        kernels, scratch, sensor = self.kernels, self._scratch, self.sensor
        wider = (1 + self._added_variance)**0.5         # scores spread by as much
        found = wider * score_threshold(self.false_alarm_rate, max(self._matcher.frequencies), REST_SCALES[-1])
        continued = wider * continuation_threshold(self.false_alarm_rate)

        # Match: take delay, gain and IRF of each pixel out of the data term.
        taken = None if background is None else self._sums_near(background * self._used) * self._near
        frame = self._padded(*kernels.prepare(
            sums, photons, self._equaliser, self._used, scratch, taken,
            None if mean is None else self._passed * mean), clutter)

        # Start with surfaces that are sure, let them spread, and search the pixels that are still open more widely.
        state, carried = self._empty(frame, warm)
        self._search(frame, state, SURE_SCALES, SURE, carried, continued)
        state = self._iterate(frame, state, *WINDOWS[0], FIRST_STEPS)
        kernels.drop_weak(state, WEAK)
        self._search(frame, state, REST_SCALES, found)

        # Iterate over wider windows.
        for sigma, radius in WINDOWS[1:]:
            state = self._iterate(frame, state, sigma, radius)

        # Finalise: outlines, threshold, intensities, standard deviations, points.
        terms = kernels.expand(frame, state, scratch)
        kernels.trim(frame, state, terms, continued, scratch)
        intensity, std, background = kernels.finalise(frame, photons, state, terms, continued, scratch)
        left = background[:1, :1]
        if not self._background.is_even:
            own = background * self._used
            seen = maps.crop(frame.counts, *frame.shape) * self._used
            near = (self._sums_near(values) * self._near for values in (own, seen))
            left = kernels.unexplained(frame, state, intensity, own, own if taken is None else taken, *near,
                                       self._passed)
        return left, background, *kernels.collect(state, intensity, std, self._rays, sensor.bin_width_m,
                                                  float(sensor.range_m(0)), sensor.num_bins)

    def _empty(self, frame: MatchedFrame, warm: bool) -> tuple:
        """A state without surfaces, and the last frame's surfaces if the start is warm."""
        scratch, carried = self._scratch, None
        state = scratch.array("state", maps.state_shape(*frame.shape, self.surfaces))
        if warm:
            carried = scratch.array("carried", state.shape)
            carried[:] = state
        return scratch.array("state", state.shape, zero=True), carried

    def _search(self, frame: MatchedFrame, state, scales, enough: float, carried=None, confirmed: float = 0.0) -> None:
        """Matched filter on sketches pooled at growing scales; the first scale at which a pixel is sure decides.

        A scale pools the pixels that finer ones, or an earlier search, left open. At the last scale a score of `enough`
        decides. Further surfaces are searched for in what those before leave unexplained; only sure ones count.
        Surfaces that are carried over from the last frame need a score of `confirmed`.
        """
        for layer in range(self.surfaces):
            matched = frame.matched
            if layer > 0:
                terms = self.kernels.expand(frame, state, self._scratch)
                matched = self.kernels.residual(frame, state, terms, layer, self._scratch)
            for scale in scales:
                least = enough if scale == scales[-1] and layer == 0 else max(SURE, enough)
                slanted = scale == SLANTED and layer == 0 and carried is None
                if slanted:
                    before = self._scratch.array("before", state.shape)
                    before[:] = state
                self.kernels.search(frame, matched, state, layer, *scale, least, self._scratch, carried, confirmed)
                if slanted:
                    self._search_slanted(frame, state, before, *scale)

    def _search_slanted(self, frame: MatchedFrame, state, before, sigma: float, step: int) -> None:
        """Slanted windows where the flat one of this scale was not sure, or might be smeared."""
        for slope in SLANTS:
            slope = tuple(part * frame.resolution_bins / sigma for part in slope)
            self.kernels.search(frame, frame.matched, state, 0, sigma, step, SURE_SLANTED, self._scratch, slope=slope,
                                before=before)

    def _iterate(self, frame: MatchedFrame, state, sigma: float, radius: int, steps: int = 1):
        """Birth and death of surfaces, then Gauss-Newton steps on the data terms pooled over the window."""
        kernels, scratch = self.kernels, self._scratch
        terms = kernels.expand(frame, state, scratch)
        state = kernels.birth_death(frame, state, terms, SAME_SURFACE**2, scratch)
        for step in range(steps):
            terms = kernels.expand(frame, state, scratch)
            after = scratch.array("state" if step == steps - 1 else "step", state.shape)
            state = kernels.pooled_step(frame, state, terms, sigma, radius, SAME_SURFACE**2, scratch, after)
        return state

    def _cloud(self, stamp_ns: int, background, row, col, rank, values, xyz) -> PointCloud:
        depth, intensity, std = values[:3]
        if self._added_variance:
            std = std * self._widening(intensity, background[row, col])
        return PointCloud(row, col, depth, intensity, std, xyz, rank, background, stamp_ns)

    def _widening(self, intensity, background) -> np.ndarray:
        """By how much the added variance widens standard deviations of depth: that of photons is in them."""
        signal, even = self._matcher.moments
        share = intensity / np.maximum(intensity + background, TINY)
        return np.sqrt(1 + self._added_variance * even / (share * signal + (1 - share) * even)).astype(np.float32)

    def warm_up(self) -> None:
        """Compile the kernels, or load them from the disk: on a CPU for frames of any size, on a GPU for this one."""
        sensor = self.sensor.cropped(slice(8), slice(8)) if self.kernels.ON_HOST else self.sensor
        Pooled(sensor, self._matcher.frequencies, self.surfaces, device=self.device)(
            noise_sketch(sensor, self._matcher.frequencies))


def check_options(surfaces: int, false_alarm_rate: float | None) -> None:
    """Raise InvalidInput unless both can be used; a rate of None stands for no test."""
    require(isinstance(surfaces, int) and 1 <= surfaces <= MAX_SURFACES, "surfaces", surfaces,
            f"an integer from 1 to {MAX_SURFACES}")
    require(false_alarm_rate is None or 0 < false_alarm_rate < 1, "false_alarm_rate", false_alarm_rate,
            "a probability between 0 and 1")
