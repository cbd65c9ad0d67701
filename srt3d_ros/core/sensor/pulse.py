"""Widths of a sensor's mean IRF, bins."""

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel


def equivalent_width(sensor: SensorModel) -> float:
    """1 / Σ h²: the bins whose background photons count as those of a matched filter."""
    return 1 / float(np.square(sensor.mean_irf).sum())


def rms_width(sensor: SensorModel) -> float:
    """Standard deviation of a photon's time; at least that of one bin, 1/√12."""
    irf = sensor.mean_irf
    bins = np.arange(len(irf))
    mean = (irf * bins).sum() / irf.sum()
    return float(np.sqrt(max((irf * (bins - mean)**2).sum() / irf.sum(), 1 / 12)))


def full_width_at_half_maximum(sensor: SensorModel) -> float:
    """By linear interpolation."""
    mean = np.pad(sensor.mean_irf, 1)
    peak, half = int(mean.argmax()), 0.5 * mean.max()
    left = peak - int(np.argmax(mean[peak::-1] <= half))
    right = peak + int(np.argmax(mean[peak:] <= half))
    before = left + (half - mean[left]) / (mean[left + 1] - mean[left])
    return float(right - (half - mean[right]) / (mean[right - 1] - mean[right]) - before)
