"""Pile-up of detectors that record only the first photon of each laser cycle, corrected where the cycles are known.

A pixel of N cycles gets λ photons per cycle from a surface at depth t with the pulse h (its integral is H), and b from
the background. Of the surface it records

    r / N = exp(−b t / T − Σ_nearer λ_j) (1 − exp(−λ)),   with the pulse λ h exp(−λ H),

which is dim and too near. Behind the surface, exp(−λ) of the background is left: a step down that moves it, too.
"""

from dataclasses import replace

import numpy as np

from srt3d_ros.core.method.cloud import PointCloud
from srt3d_ros.core.method.matched_frame import Matcher
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequencies import angular_frequencies
from srt3d_ros.core.sketching.sketch import Sketch

SATURATED = 0.95        # of the cycles with a photon: the few others say little of the flux
STEPS = 8               # Newton's, from λ = r / N: they approach the root from below
FLUXES = np.concatenate([[0], np.geomspace(0.01, 8, 49)])       # λ of the table
TINY = 1e-6


def saturated(sketch: Sketch, sensor: SensorModel) -> np.ndarray:
    """Whether a pixel saw a photon in nearly every cycle, bool [rows, cols]; False where masked or not known."""
    crowded = sketch.photons > SATURATED * (sketch.cycles or np.inf)
    return crowded if sensor.mask is None else crowded & sensor.mask


class PileUp:
    """Takes pile-up out of one sensor's sketches and clouds.

    Attributes:
        background_share: the background's share of the light in the last cloud.
    """

    def __init__(self, matcher: Matcher):
        sensor = self._sensor = matcher.sensor
        self._omega, self._used = angular_frequencies(matcher.frequencies, sensor.num_bins), matcher.used > 0
        self._armed = sensor.armed_bin or 0.0
        self._bins = sensor.num_bins - max(self._armed, 0)      # of T, in which the detector is armed
        self._shifts, self._step_shifts = (_shifts(matcher, self._omega, step) for step in (0, 1 / self._bins))
        self.forget()

    def forget(self) -> None:
        """Begin anew: with all light from the background; behind a gate, with none from before it."""
        self.background_share = float(self._armed >= 0)

    def without_decay(self, sketch: Sketch) -> Sketch:
        """The sketch without the decay of the background: less n (β̂(b) − β̂(0)), with each pixel's own b.

        Pile-up makes a background decay as exp(−b x / T): β̂_l(b) = b / (b − i ω_l T) if the detector is armed from bin
        0 on. The share of the background in the last cloud is taken for that of each pixel.
        """
        share, period = self.background_share, 1j * self._omega * self._bins
        flux = np.maximum(share * self._flux(sketch), TINY)[..., None]
        armed = np.exp(1j * self._omega * max(self._armed, 0))
        decays = flux / (flux - period) * (armed - np.exp(-flux)) / -np.expm1(-flux)
        taken = share * sketch.photons[..., None] * (decays - (1 - armed) / period)
        return replace(sketch, sums=(sketch.sums - taken).astype(np.complex64), cycles=0)

    def corrected(self, cloud: PointCloud, sketch: Sketch) -> PointCloud:
        """The cloud with intensities N λ, backgrounds N b, depths moved back, and std with the error of λ."""
        sensor, cycles = self._sensor, sketch.cycles
        for _ in range(STEPS if self._armed < 0 else 1):        # what passes a gate depends on the share
            flux = self._flux(sketch)
            signal, background, error = self._fluxes(cloud, sketch, flux)
            flux[cloud.row, cloud.col] = background
            of_all = flux[self._used].sum()
            self.background_share = float(of_all / max(of_all + signal.sum(), TINY))
        pulse, step = (np.interp(signal, FLUXES, shifts) for shifts in (self._shifts, self._step_shifts))
        shift = pulse + background * (step - pulse)
        error = error * np.interp(signal, FLUXES, np.abs(np.gradient(self._shifts, FLUXES)))
        error = np.where(saturated(sketch, sensor)[cloud.row, cloud.col], np.hypot(error, shift), error)
        depth = np.mod(cloud.depth_bins - shift, sensor.num_bins).astype(np.float32)
        depth[depth >= sensor.num_bins] = 0             # where rounding made it T
        return replace(cloud, depth_bins=depth, xyz=sensor.xyz(cloud.row, cloud.col, depth),
                       intensity=(cycles * signal / sensor.exposure[cloud.row, cloud.col]).astype(np.float32),
                       depth_std_bins=np.hypot(cloud.depth_std_bins, error).astype(np.float32),
                       background=(cycles * flux).astype(np.float32))

    def _flux(self, sketch: Sketch) -> np.ndarray:
        """Λ = −ln(1 − n / (N + ½)), photons per cycle in the sketch's bins, float64 [rows, cols].

        Behind a gate, N is less: of the cycles, exp(−b · bins before it / T) come without a photon from there. At most
        one such photon per cycle is believed.
        """
        photons, flux = sketch.photons.astype(np.float64), np.zeros(sketch.photons.shape)
        for _ in range(STEPS if self._armed < 0 else 1):
            before = self.background_share * flux * max(-self._armed, 0) / self._bins
            reached = sketch.cycles * np.exp(-np.minimum(before, 1))
            flux = -np.log1p(-photons / (np.maximum(reached, photons) + 0.5))
        return flux

    def _fluxes(self, cloud: PointCloud, sketch: Sketch, flux: np.ndarray) -> tuple[np.ndarray, ...]:
        """λ and b of each point's pixel, and the standard deviation of λ, float64 [N] each."""
        sensor, cycles, at = self._sensor, sketch.cycles, (cloud.row, cloud.col)
        place = np.cumsum(cloud.surface == 0) - 1, cloud.surface        # row of a pixel with points, and column
        shape = place[0].max(initial=-1) + 1, cloud.surface.max(initial=0) + 1
        late = 0 if sensor.delay_bins is None else sensor.delay_bins[at]
        since, recorded, total = np.zeros(shape), np.zeros(shape), np.zeros((shape[0], 1))
        since[place] = np.maximum((cloud.depth_bins + late) % sensor.num_bins - self._armed, 0) / self._bins
        recorded[place] = cloud.intensity * sensor.exposure[at] / cycles
        total[place[0], 0] = flux[at]
        nearer = since[:, None] < since[:, :, None]             # [pixels, K, K]: of each surface, those before it
        signal = recorded
        for _ in range(STEPS):
            background = np.maximum(total - signal.sum(axis=1, keepdims=True), 0)
            seen = recorded * np.exp(background * since + (nearer * signal[:, None]).sum(axis=2))
            slope = np.exp(-signal) + since * seen * (background > 0)
            signal = np.clip(signal + (seen + np.expm1(-signal)) / slope, 0, np.log(2 * cycles))
        variance = since**2 * np.expm1(total) / cycles      # of b t / T; r, pooled, is sure beside it
        return signal[place], background[place[0], 0], (seen * np.sqrt(variance) / slope)[place]


def _shifts(matcher: Matcher, omega: np.ndarray, step: float) -> np.ndarray:
    """How far a matched filter's peak lies from t for λ of FLUXES and a background of `step` photons a bin, bins.

    The spectrum of λ h exp(−λ H) − step (1 − exp(−λ H)) is that of its first part times 1 + step / (i ω_l).
    """
    irf = np.atleast_2d(matcher.sensor.irf).mean(axis=0, dtype=np.float64)
    left = np.exp(-np.outer(FLUXES, np.concatenate([[0], np.cumsum(irf)])))         # of the cycles, at edges of bins
    pulses = -np.diff(left, axis=1)
    pulses[0] = irf
    phases = np.exp(1j * np.outer(np.arange(len(irf)) - matcher.sensor.irf_ref, omega))
    matched = np.conj(matcher.spectrum) * (pulses @ phases) * (1 + step / (1j * omega))
    depths = np.linspace(-3, 3, 6001) / np.sqrt((omega**2 * matcher.energy).sum() / matcher.energy.sum())
    return depths[(matched @ np.exp(-1j * np.outer(omega, depths))).real.argmax(axis=1)]
