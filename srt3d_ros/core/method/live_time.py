"""LiveTime: the light that a detector with a dead time of a laser period or longer receives.

A photon blinds its pixel q times for each bin, and once more for the next d (`DeadTime`). Of N cycles, a pixel with n
photons was therefore live at bin t in N − q n − #{photons in (t − d, t]}, and recorded its light in these. Background
decays only where a surface blinds. Photons outside a gate count by how often they blind its bins, on average.
"""

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel


class LiveTime:
    """Light from photons, for one sensor.

    Args:
        fluxes: float64 [F], λ of `pulses`, photons per cycle, from 0 on.

    Attributes:
        pulses: of `recorded_pulses`.
        mean: cycles for which a background photon blinds a bin, on average.
    """

    def __init__(self, sensor: SensorModel, fluxes: np.ndarray):
        dead, irf = sensor.dead_time, sensor.mean_irf
        self._dead, self._fluxes = dead, fluxes
        self.mean = float(dead.blinded(np.arange(dead.num_bins) + 0.5).mean())
        awake = dead.period - dead.rest
        self._wraps = awake < min(dead.rest, len(irf))      # a pulse blinds its beginning in the next cycle
        if self._wraps:
            self.pulses = abs(recorded_pulses(-fluxes, irf[::-1], awake)[:, ::-1])
        else:
            self.pulses = recorded_pulses(fluxes, irf, dead.rest)
        self._recorded = np.concatenate([[0], self.pulses[1:].sum(axis=1)])

    def __call__(self, depth: np.ndarray, recorded: np.ndarray, photons: np.ndarray, cycles: np.ndarray
                 ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """λ of each surface, float64 [pixels, K], b of each pixel, [pixels], and λ's standard deviation by that of n.

        Args:
            depth, recorded: float64 [pixels, K], t (bins) and r / N of each surface; r = 0: none.
            photons: float64 [pixels, 1], n / N.
            cycles: float64 [pixels, 1], N, without those for which photons outside the gate blinded.
        """
        dead, left = self._dead, photons - recorded.sum(axis=1, keepdims=True)
        mean_live = 1 - (recorded * dead.blinded(depth)).sum(axis=1, keepdims=True) - self.mean * left
        background = left / np.maximum(mean_live, 1 / cycles)
        since = (depth[:, :, None] - depth[:, None]) % dead.period          # of each surface, since each
        blinds = (since <= dead.rest) & (self._wraps | ~np.eye(depth.shape[1], dtype=bool))
        # Where a surface blinds, less background is recorded and blinds; elsewhere, more.
        twice = np.maximum(np.minimum(since, 2 * dead.rest - since), 2 * dead.rest - dead.period).clip(0)
        blinds = blinds + background[:, None] / dead.num_bins * (dead.rest**2 / dead.period - twice)
        live = 1 - dead.periods * photons - (self.mean - dead.periods) * left
        live = np.maximum(live - (blinds * recorded[:, None]).sum(axis=2), 1 / cycles)
        signal = np.interp(recorded / live, self._recorded, self._fluxes)
        slope = np.maximum(live + (recorded if self._wraps else -recorded), 1 / cycles)
        return signal, background[:, 0], recorded / slope * self.mean * np.sqrt(photons / cycles)   # σ_n: √n · live


def recorded_pulses(fluxes: np.ndarray, irf: np.ndarray, blind: float = np.inf) -> np.ndarray:
    """What a live detector records of λ · IRF if each photon blinds the next `blind` bins; of λ = 0 the IRF.

    Returns:
        float64 [F, L], photons per cycle; λ h exp(−λ H) behind which the detector stays blind.
    """
    total = np.zeros((len(fluxes), len(irf) + 1))       # before each edge of a bin
    for i, light in enumerate(irf.astype(np.float64)):
        edge, part = divmod(max(i - blind, 0), 1)
        awake = (1 - part) * total[:, int(edge)] + part * total[:, int(edge) + 1]
        total[:, i + 1] = total[:, i] - (1 - total[:, i] + awake) * np.expm1(-fluxes * light)
    pulses = np.diff(total, axis=1)
    pulses[0] = irf
    return pulses
