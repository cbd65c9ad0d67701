"""The data term weighted by W = Σ_θ⁻¹ (SRT3D, ICASSP 2022, eq. 6) in place of the identity."""

from dataclasses import replace

import numpy as np

from srt3d_ros.core import layout
from srt3d_ros.core.frame import Frame, curvatures, score_moments
from srt3d_ros.core.frequencies import angular_frequencies, irf_spectrum
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.weighting import LEVELS, weighted_steps


class Precision:
    """Makes frames on which a gradient step in depth is the one of the weighted data term.

    That step is a sum over the real and imaginary parts of the sketch, turned back by the depth: Σ_l a_l Re + b_l Im,
    with the weights of `weighted_steps`. With `Frame.matched` multiplied by (b_l + i a_l) / ω_l it is the slope in d of
    Σ_l Re(matched_l exp(−i ω_l d)), which is what the kernels climb. Nothing else of them changes, and no time is lost.

    W depends on the share of signal among the photons. One share is taken for a whole frame: pools of pixels have no
    other, and the weights hardly change with it.

    Args:
        sensor: IRF and T.
        frequencies: the integers k_l.
    """

    def __init__(self, sensor: SensorModel, frequencies):
        self._sensor = sensor
        self._omega = angular_frequencies(frequencies, sensor.num_bins)
        self._spectrum = np.atleast_2d(irf_spectrum(sensor, frequencies)).mean(axis=0)
        self._table = weighted_steps(sensor, frequencies, "precision").table

    def __call__(self, frame: Frame, state, kernels) -> Frame:
        """The padded frame, weighted for the share of signal among its photons that the state's points show.

        Frame and state lie on the kernels' device.
        """
        signal = float((state[:, :, layout.INTENSITY] * frame.exposure[:, None]).sum())
        return self.weighted(frame, min(signal / max(float(frame.noise.sum()), 1), 1), kernels.array).on(kernels)

    def weighted(self, frame: Frame, share: float, array=np.asarray) -> Frame:
        """The frame weighted for a share of signal among the photons, 0 … 1; `array` brings arrays to its device.

        The same frame, if the mean of the pixels' IRFs is so unlike each that its weights would lead away from the top.
        """
        real, imaginary = self._table[round(share * (LEVELS - 1)), :2].astype(np.float64)
        weights = (imaginary + 1j * real) / self._omega
        filters = np.conj(self._spectrum) * weights
        energy = (filters * self._spectrum).real
        if min(energy.sum(), (energy * self._omega**2).sum()) <= 0:     # pixels' IRFs too different for common weights
            return frame
        scale = energy.sum() / (np.abs(filters)**2).sum()       # then energy is that of signal and of noise alike
        weights, filters, energy = weights * scale, filters * scale, energy * scale
        moments = score_moments(self._sensor, self._omega, filters, np.abs(filters)**2)
        return replace(frame, matched=_turned(frame.matched, weights, array), energy=energy.astype(np.float32),
                       moments=moments[0], intensity_moments=moments[1],
                       **curvatures(energy, self._omega / (2 * np.pi)))


def _turned(matched, weights: np.ndarray, array):
    """`Frame.matched`, each frequency multiplied by its complex weight."""
    m = len(weights)
    a, b = (array(np.tile(part, 2).astype(np.float32)[:, None]) for part in (weights.real, weights.imag))
    turned = matched * a
    turned[:, :m] -= matched[:, m:] * b[m:]
    turned[:, m:] += matched[:, :m] * b[:m]
    return turned
