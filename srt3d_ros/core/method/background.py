"""Background: learns how background photons spread over the bins, and removes them from sketches.

A background photon at bin x adds exp(i ω_l x) to its pixel's sums: β̂_l on average, 0 if the background is even. Fog
before the scene, a dead time, or a gate that opens slowly make it uneven. B background photons are removed from a frame
as B·β̂_l before it is reconstructed. What its cloud leaves unexplained corrects β̂ and B for the next frame.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from srt3d_ros.core.method.matched_frame import Matcher
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.kernels.constants import EPSILON

BACKGROUNDS = ("auto", "sensor", "flat")
# A residual smaller than this share of the surfaces is blamed on the IRF. Measured IRFs were wrong by 2 to 5 % (four
# real scenes). Fog that does harm, up to an SBR of 3, leaves more than 25 %; above, surfaces stand out.
WRONG_IRF = 0.1
# χ² per degree of freedom from which a background is uneven: with 2 m = 20, noise exceeds it in one of 10⁵ frames. Even
# backgrounds measured 0.0 to 0.4, wrong IRFs 1.7 and 2.4, a real uneven background 4.8, fog at an SBR ≤ 1 24 to 100.
SIGNIFICANT = 3.0
# Share of a surface's signal in the upper half of the frequencies, above which a residual is surfaces that many pixels
# share, not background. Measured 0.0 to 0.25 in fog, and 0.47 to 0.69 for two walls of which one may be shown.
SHARP = 0.33


@dataclass(frozen=True, eq=False)
class BackgroundEstimate:
    """The background of the next frame.

    Args:
        mean: complex [m], β̂; None: even.
        photons: float32 [rows, cols], background photons of the last cloud, in one frame; None: all photons of the
            frame.
        converged: another pass over the same frame would change it by less than noise.
        candidate: complex [m], β̂ to try if the last frame, taken for even, was significantly uneven; else None.
    """

    mean: np.ndarray | None = None
    photons: np.ndarray | None = None
    converged: bool = True
    candidate: np.ndarray | None = None


class RemovedBackground(NamedTuple):
    """What removes a background from a frame.

    Args:
        photons: float32 [rows, cols], B.
        mean: complex64 [m], β̂.
        clutter: float32 [T], of `MatchedFrame`.
    """

    photons: np.ndarray
    mean: np.ndarray
    clutter: np.ndarray


class Unexplained(NamedTuple):
    """What the points leave unexplained of a frame: photons, and the sums of the kernel `unexplained` over all pixels.

    In the sums, each pixel counts by its share, background photons over all photons.

    Args:
        photons: float32 [rows, cols], photons that are not the points', at least 0 in each pixel.
        left: complex64 [m], the sketch's phase sums less those of the points.
        seen: complex64 [m], the phase sums of the points.
        own, taken: photons that are not the points', and photons of the background that was removed.
        noise: variance of each number of `left`.
        misfit: Σ |z_l − what the points explain|², in units of the photons' noise; all pixels count alike.
    """

    photons: np.ndarray
    left: np.ndarray
    seen: np.ndarray
    own: np.float64
    taken: np.float64
    noise: np.float64
    misfit: np.float64

    @classmethod
    def unpacked(cls, photons: np.ndarray, sums: np.ndarray) -> Self:
        """From the kernels' float32 [4m + 4]: real and imaginary parts of `left`, those of `seen`, the four numbers."""
        left_real, left_imaginary, seen_real, seen_imaginary = sums[:-4].reshape(4, -1)
        return cls(photons, left_real + 1j * left_imaginary, seen_real + 1j * seen_imaginary,
                   *np.maximum(sums[-4:].astype(np.float64), EPSILON))


class Background:
    """How β̂ and B of one frame follow from those of the frame before; keeps nothing.

    Args:
        matcher: of the frames.
        kind: "auto": from the last cloud, even unless significantly uneven, starting with the sensor's
            background_shape if it has one; "sensor": that shape, or even; "flat": even.

    Attributes:
        first: the background of a first frame.
    """

    def __init__(self, matcher: Matcher, kind: str = "auto"):
        sensor = self._sensor = matcher.sensor
        self._matcher, self._learns = matcher, kind == "auto"
        self.first = BackgroundEstimate()
        if kind != "flat" and sensor.background_shape is not None:
            self._known = np.conj(np.fft.rfft(sensor.background_shape))
            self.first = BackgroundEstimate(self._known[list(matcher.frequencies)], converged=False)

    @property
    def is_even(self) -> bool:
        """Whether it is always even: nothing to remove or to learn."""
        return self.first.mean is None and not self._learns

    def removed(self, background: BackgroundEstimate, sketch: PhaseSums) -> RemovedBackground | tuple[()]:
        """What removes a background from a frame; () if it is even."""
        mean = background.mean
        if mean is None:
            return ()
        photons = sketch.photons if background.photons is None else background.photons * sketch.frames
        return RemovedBackground(photons.astype(np.float32), mean.astype(np.complex64), self._clutter(mean))

    def candidates(self, sketch: PhaseSums, learned: BackgroundEstimate) -> list[BackgroundEstimate]:
        """Uneven backgrounds to try on a frame: what the last cloud left, and the mean of all photons.

        Two, because each fails once: the first misses fog that was fitted as a surface; the second misses a wall that
        fills the view. None unless the last frame was significantly uneven, or if both are as sharp as a surface.
        """
        if learned.candidate is None:
            return []
        passed, used = self._matcher.passed, sketch.photons * self._matcher.used
        adds = (np.conj(passed) * self._matcher.equaliser * sketch.sums).sum(axis=(0, 1))
        weights = (np.abs(passed)**2 * used[..., None]).sum(axis=(0, 1))
        starts = (learned.candidate, learned.photons), (adds / np.maximum(weights, EPSILON), None)
        return [BackgroundEstimate(mean, photons) for mean, photons in starts if not self._is_sharp(mean)]

    def _is_sharp(self, mean: np.ndarray) -> bool:
        """Whether its upper half of frequencies is as strong as that of surfaces."""
        upper = np.argsort(self._matcher.frequencies)[len(mean) // 2:]
        return bool((np.abs(mean[upper])**2).sum() > SHARP**2 * self._matcher.energy[upper].sum())

    def learned(self, before: BackgroundEstimate, frame: Unexplained) -> BackgroundEstimate:
        """The background of the next frame, from the one removed from a frame and what the frame's points leave."""
        own, taken, noise = frame.own, frame.taken, frame.noise
        mean = np.zeros(len(frame.left)) if before.mean is None else before.mean
        uneven = frame.left / np.maximum(self._matcher.energy, EPSILON) + taken * mean
        chi2 = (np.abs(uneven)**2 / (noise + np.abs(WRONG_IRF * frame.seen)**2)).mean()
        shown = uneven / own
        shown = shown / np.maximum(np.abs(shown), 1)        # no longer than 1, as a mean of unit vectors
        if before.mean is None:
            found = self._learns and bool(chi2 > SIGNIFICANT)
            return BackgroundEstimate(None, frame.photons, converged=not found, candidate=shown if found else None)
        if self._learns and chi2 < SIGNIFICANT / 2:
            return BackgroundEstimate()
        after = shown if self._learns else mean
        change = own * after - taken * mean
        return BackgroundEstimate(after, frame.photons, converged=bool((np.abs(change)**2).mean() < noise))

    def most_clutter(self, background: BackgroundEstimate) -> float:
        """The largest clutter of a background at any depth; 1 if it is even."""
        return 1.0 if background.mean is None else float(self._clutter(background.mean).max())

    def _clutter(self, mean: np.ndarray) -> np.ndarray:
        """`MatchedFrame.clutter`: √(variance of a background photon's response at each bin / its variance if even)."""
        bins, (response, square, energy) = self._sensor.num_bins, self._responses
        spread = np.conj(self._between(mean) if self._learns else self._known)
        first, second = (np.fft.irfft(values * spread, bins) for values in (response, square))
        return np.sqrt(np.maximum((second - first**2) / energy, 1)).astype(np.float32)

    @cached_property
    def _responses(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Spectra over distance of a photon's response to the matched filter and of its square; variance if even."""
        spectrum, bins = self._matcher.spectrum, np.arange(self._sensor.num_bins)
        response = (np.exp(1j * np.outer(bins, self._matcher.omega)) @ np.conj(spectrum)).real
        response, square = (np.conj(np.fft.rfft(values)) for values in (response, response**2))
        return response, square, np.square(np.abs(spectrum)).sum() / 2

    def _between(self, mean: np.ndarray) -> np.ndarray:
        """β̂ interpolated to all k, complex [T // 2 + 1]; turned back by its mean depth, it varies slowly."""
        order, wanted = np.argsort(self._matcher.frequencies), np.arange(self._sensor.num_bins // 2 + 1)
        k, mean = np.array([0, *np.array(self._matcher.frequencies)[order]]), np.concatenate([[1], mean[order]])
        turn = np.angle(mean[1]) / k[1]
        known = mean * np.exp(-1j * k * turn)
        between = np.interp(wanted, k, known.real, right=0) + 1j * np.interp(wanted, k, known.imag, right=0)
        return between * np.exp(1j * wanted * turn)
