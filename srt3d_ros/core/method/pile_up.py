"""PileUp: corrects detectors that record only the first photon of each laser cycle, if the cycles are known.

In N cycles a pixel receives λ photons per cycle from a surface at depth t with the pulse h (with integral H), and b
from the background. Of the surface it records

    r / N = exp(−b t / T − Σ_nearer λ_j) (1 − exp(−λ)),   with the pulse λ h exp(−λ H),

which is dim and too near. Behind the surface, exp(−λ) of the background is left: the step down moves the peak, too.
With a gate, t counts from its first bin, and N are the cycles without a photon before it. A dead time longer than a
cycle has its own equations: `LiveTime`.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from srt3d_ros.core.method.live_time import LiveTime, recorded_pulses
from srt3d_ros.core.method.matched_frame import Matcher
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sketching.sums import PhaseSums
from srt3d_ros.kernels.constants import EPSILON, LOCAL_SIGMA
from srt3d_ros.kernels.devices import kernels_for

SATURATED = 0.95        # share of cycles that photons cost, above which the others say little about the flux
NEWTON_STEPS = 8        # from λ = r / N, they approach the root from below
POOLED = 4 * np.pi * LOCAL_SIGMA**2     # pixels that count in a local mean
FLUXES = np.concatenate([[0], np.geomspace(0.01, 8, 49)])       # λ of the tables of shifts


def saturated(sketch: PhaseSums) -> np.ndarray:
    """Whether a pixel saw a photon in nearly every cycle, bool [rows, cols]; False if masked or not known."""
    return (_cost(sketch) > SATURATED * sketch.armed_cycles) & (sketch.cycles > 0) & sketch.sensor.used


def contradiction(sketch: PhaseSums) -> str:
    """What photons, `cycles` and `dead_time_s` say against each other, or ""."""
    sensor = sketch.sensor
    if not sketch.cycles:
        return "dead_time_s not used, pile-up not corrected: give cycles" if sensor.dead_time_s else ""
    more = (_cost(sketch) > sketch.cycles)[sensor.used]
    if not more.any():
        return ""
    rule = f"dead_time_s {sensor.dead_time_s:g}" if sensor.dead_time.periods else "one photon a cycle"
    return (f"pile-up is not corrected well: {more.mean():.1%} of the pixels have more photons than "
            f"{sketch.cycles} cycles with {rule} allow")


def _cost(sketch: PhaseSums) -> np.ndarray:
    """Laser cycles that a pixel's photons cost, 1 each at least; [rows, cols]."""
    return max(sketch.sensor.dead_time.cycles, 1) * sketch.photons


class Seen(NamedTuple):
    """What one cloud says of pile-up in the next frame.

    Args:
        background_share: of all photons.
        shift: float32 [rows, cols], how far each pixel's first surface was moved, bins; 0 without one.
    """

    background_share: float
    shift: np.ndarray


class PileUp:
    """Corrects pile-up in one sensor's sketches and estimates; keeps nothing from frame to frame.

    Attributes:
        first: before the first cloud, all light may be background.
    """

    def __init__(self, matcher: Matcher):
        self._sensor, self._used = matcher.sensor, matcher.used > 0
        self._kernels = kernels_for("cpu").for_shape(*matcher.sensor.shape, 1, matcher.frequencies)
        self.first = Seen(1.0, np.zeros(matcher.sensor.shape, np.float32))
        dead, omega = matcher.sensor.dead_time, matcher.omega
        self._omega, step = omega, 1 / matcher.sensor.num_bins / (1j * omega)
        self._live = LiveTime(matcher.sensor, FLUXES) if dead.periods else None
        if self._live and dead.rest < dead.num_bins:
            step = step * (1 - np.exp(1j * omega * dead.rest))          # the background is back
        pulses = self._live.pulses if self._live else recorded_pulses(FLUXES, matcher.sensor.mean_irf)
        self._shifts, self._step_shifts = (_shifts(matcher, pulses, 1 + height * step) for height in (0, 1))

    def without_decay(self, sketch: PhaseSums, seen: Seen) -> PhaseSums:
        """The sketch without the decay of its background: minus n_b β̂(b), with each pixel's own b; and turned.

        Pile-up makes the background decay as exp(−b x / T): β̂_l(b) = b / (b − i ω_l T). The same share of all photons
        counts as background everywhere; after a long dead time, it does not decay. What is left is turned back by the
        pixel's `shift`, because pixels of unlike flux are pooled next, and each is moved by its own.
        """
        share = 0.0 if self._live else seen.background_share
        flux = (share * self._flux(sketch))[..., None]
        decay = flux / (flux - 1j * self._omega * self._sensor.num_bins)
        taken = share * sketch.photons[..., None] * decay
        turned = (sketch.sums - taken) * np.exp(-1j * self._omega * seen.shift[..., None])
        return replace(sketch, sums=turned.astype(np.complex64), cycles=0)

    def corrected(self, cloud: PointCloud, sketch: PhaseSums, seen: Seen) -> tuple[PointCloud, Seen]:
        """Intensities N λ, background N b (local means), depths moved back, std with λ's error; what the cloud says.

        `cloud` is that of `without_decay`.
        """
        sensor, flux, at = self._sensor, self._flux(sketch), (cloud.row, cloud.col)
        signal, background, error = self._fluxes(cloud, sketch, flux)
        share, photons = np.ones(flux.shape), sketch.photons * self._used
        share[at] = background / np.maximum(flux[at], EPSILON)
        background_share = float((share * photons).sum() / max(photons.sum(), 1))
        left = flux.copy()
        np.subtract.at(left, at, signal)
        left = (sketch.cycles * left).astype(np.float32)
        pulse, step = (np.interp(signal, FLUXES, shifts) for shifts in (self._shifts, self._step_shifts))
        shift = pulse + background * (step - pulse)
        error = error * np.interp(signal, FLUXES, np.abs(np.gradient(self._shifts, FLUXES)))
        error = np.where(saturated(sketch)[at], np.hypot(error, shift), error)
        first, moved = cloud.surface == 0, np.zeros_like(seen.shift)
        moved[cloud.row[first], cloud.col[first]] = shift[first]
        there = (moved != 0).astype(np.float32)
        pooled = self._kernels.local_mean((moved - seen.shift) * there, there)
        shift = np.where(first, pooled[at], shift - seen.shift[at])
        error = np.where(first, error / POOLED**0.5, error)
        depth = sensor.wrapped(cloud.depth_bins - shift)
        cloud = replace(cloud, depth_bins=depth, xyz=sensor.xyz(cloud.row, cloud.col, depth),
                        intensity=(sketch.cycles * signal / sensor.exposure[at]).astype(np.float32),
                        depth_std_bins=np.hypot(cloud.depth_std_bins, error).astype(np.float32),
                        background=self._kernels.background(left, sensor.exposure))
        return cloud, Seen(background_share, moved)

    def _flux(self, sketch: PhaseSums) -> np.ndarray:
        """Λ = −ln(1 − n / (N + ½)), photons per cycle without pile-up, float64 [rows, cols]."""
        if self._live:      # as if all were background
            return sketch.photons / np.maximum(sketch.armed_cycles - self._live.mean * sketch.photons, 1)
        return -np.log1p(-(sketch.photons / (sketch.armed_cycles + 0.5)))

    def _fluxes(self, cloud: PointCloud, sketch: PhaseSums, flux: np.ndarray) -> tuple[np.ndarray, ...]:
        """λ of each point, b of its pixel, and the standard deviation of λ, float64 [N] each; `LiveTime` corrects Λ."""
        sensor, at = self._sensor, (cloud.row, cloud.col)
        cycles, place = np.maximum(sketch.armed_cycles[at], 1), (np.cumsum(cloud.surface == 0) - 1, cloud.surface)
        shape = place[0].max(initial=-1) + 1, cloud.surface.max(initial=0) + 1          # pixels with points, K
        since, recorded, total, most = np.zeros(shape), np.zeros(shape), np.zeros((shape[0], 1)), np.ones((shape[0], 1))
        since[place] = (cloud.depth_bins + sensor.late[at]) % sensor.num_bins / sensor.num_bins    # t / T
        recorded[place] = cloud.intensity * sensor.exposure[at] * sketch.frames[at] / cycles      # r / N
        if self._live:
            total[place[0], 0], most[place[0], 0] = sketch.photons[at] / cycles, cycles
            signal, background, std = self._live(since * sensor.num_bins, recorded, total, most)
            flux[at] = (background + signal.sum(axis=1))[place[0]]
            return signal[place], np.maximum(background, 0)[place[0]], std[place]
        total[place[0], 0], most[place[0], 0] = flux[at], np.log(2 * cycles)
        nearer = since[:, None] < since[:, :, None]             # [pixels, K, K]: of each surface, those before it
        signal = seen = slope = recorded
        background = total
        for _ in range(NEWTON_STEPS):
            background = np.maximum(total - signal.sum(axis=1, keepdims=True), 0)
            seen = recorded * np.exp(background * since + (nearer * signal[:, None]).sum(axis=2))
            slope = np.exp(-signal) + since * seen * (background > 0)
            signal = np.clip(signal + (seen + np.expm1(-signal)) / slope, 0, most)
        std = (since * seen / slope)[place] * np.sqrt(np.expm1(flux[at]) / cycles)      # by Λ; r is pooled, hence sure
        return signal[place], background[place[0], 0], std


def _shifts(matcher: Matcher, pulses: np.ndarray, step: np.ndarray) -> np.ndarray:
    """How far the matched filter's peak lies from t, bins, for each λ of FLUXES.

    The spectrum of a pulse λ h exp(−λ H) and the step of the background behind it, −(b / T) (1 − exp(−λ H)), is that
    of the pulse times `step`, 1 + b / (i ω_l T).
    """
    omega = matcher.omega
    phases = np.exp(1j * np.outer(matcher.sensor.irf_bins, omega))
    matched = np.conj(matcher.spectrum) * (pulses @ phases) * step
    depths = np.linspace(-3, 3, 6001) / np.sqrt((omega**2 * matcher.energy).sum() / matcher.energy.sum())
    return depths[(matched @ np.exp(-1j * np.outer(omega, depths))).real.argmax(axis=1)]
