"""SMLE: sketched maximum likelihood, pixel by pixel.

    M. P. Sheehan, J. Tachella, M. E. Davies, "A sketching framework for reduced data transfer in photon counting
    lidar", IEEE Transactions on Computational Imaging 7, 2021.

θ̂ = arg min n (z − Ψ_θ)ᵀ W (z − Ψ_θ): the sketch of n photons is normally distributed around Ψ_θ with covariance
Σ_θ / n, so W = Σ_θ⁻¹ is maximum likelihood but for the determinant, which n outweighs; W = identity is simpler and less
exact. The matched filter on the sketch starts, gradient steps scaled by the inverse curvature follow.
"""

import numpy as np

from srt3d_ros.core.baselines.sketched import SketchedBaseline, matched_filter
from srt3d_ros.core.matched_frame import MatchedFrame
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.thresholds import score, score_threshold

STEPS = 10
RATE = 0.5          # each step halves what is left of the error


class SMLE(SketchedBaseline):
    """As in the paper, with weighting "precision", and every pixel that saw photons shows a point.

    With a false_alarm_rate, points of less evidence in the matched filter are left out.
    """

    def __init__(self, sensor: SensorModel, frequencies, surfaces: int = 1, weighting: str = "precision",
                 false_alarm_rate: float | None = None, device: str = "auto"):
        super().__init__(sensor, frequencies, surfaces, weighting, false_alarm_rate, device)

    def points(self, frame: MatchedFrame) -> tuple[np.ndarray, np.ndarray]:
        """Maximum likelihood depths and intensities, [rows, K, cols]."""
        there = frame.on(self.kernels)
        depth, intensity = matched_filter(there, self.surfaces, self.kernels)
        if self.false_alarm_rate is not None:
            shown = score(frame, intensity * frame.exposure[:, None], frame.counts[:, None])
            intensity[shown <= score_threshold(self.false_alarm_rate, max(self._matcher.frequencies))] = 0
        depth, intensity = self.kernels.array(depth), self.kernels.array(intensity)
        for _ in range(STEPS):
            self.step(there, RATE, 0.0, depth, intensity)
        return self.kernels.numpy(depth), self.kernels.numpy(intensity)
