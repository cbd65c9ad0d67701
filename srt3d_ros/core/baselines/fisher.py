"""How exactly full times of arrival tell the depth."""

import numpy as np

from srt3d_ros.core.sensor import SensorModel

RATIOS = np.geomspace(1e-7, 1e3, 101)       # background photons per bin and signal photon


def irf_slope(irf: np.ndarray) -> np.ndarray:
    """h′ between neighbouring bins' means, per bin; as long as the IRF, [..., L]."""
    padded = np.pad(irf.astype(np.float64), [(0, 0)] * (irf.ndim - 1) + [(1, 1)])
    return (padded[..., 2:] - padded[..., :-2]) / 2


class DepthInformation:
    """Fisher information of a Poisson process r h(x − t) + b on t: r Σ_x h′(x)² / (h(x) + b / r), bins⁻².

    Args:
        sensor: gives h; of sensors with an IRF per pixel the mean IRF.
    """

    def __init__(self, sensor: SensorModel):
        irf = np.atleast_2d(sensor.irf).mean(axis=0).astype(np.float64)
        slope = irf_slope(irf)
        self._per_photon = np.array([max((slope**2 / (irf + ratio)).sum(), 1e-12) for ratio in RATIOS])

    def std(self, signal: np.ndarray, background: np.ndarray) -> np.ndarray:
        """Standard deviation of efficient depths, bins, from r and b, photons and photons per bin that were seen."""
        signal = np.maximum(signal, 1e-6)
        return 1 / np.sqrt(signal * self.per_photon(background / signal))

    def per_photon(self, ratio: np.ndarray) -> np.ndarray:
        """What each signal photon adds, bins⁻², amid a background of b / r per bin."""
        return np.interp(np.log(np.maximum(ratio, RATIOS[0])), np.log(RATIOS), self._per_photon)
