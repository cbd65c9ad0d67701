"""The published methods on sketches: SMLE and SRT3D.

    M. P. Sheehan, J. Tachella, M. E. Davies, "A sketching framework for reduced data transfer in photon counting
    lidar", IEEE Transactions on Computational Imaging 7, 2021 (SMLE).
    J. Tachella, M. P. Sheehan, M. E. Davies, "Sketched RT3D: how to reconstruct billions of photons per second",
    ICASSP 2022 (SRT3D).

Both minimise n (z − Ψ_θ)ᵀ W (z − Ψ_θ) for each pixel (SRT3D, eq. 6), SRT3D with a regularisation ρ(θ) over all pixels:
by gradient steps scaled by the inverse curvature, from a matched filter on each pixel's sketch.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np

from srt3d_ros.core.baselines.plug_and_play import (
    FAINTEST,
    RATE,
    depth_scale_bins,
    plug_and_play,
    points_needed,
)
from srt3d_ros.core.method.matched_frame import MatchedFrame, Matcher, SensorOnDevice
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.frequencies import angular_frequencies, irf_spectrum, mean_energy
from srt3d_ros.core.sketching.sums import PhaseSums, noise_sketch
from srt3d_ros.kernels import maps
from srt3d_ros.kernels.contract import Array

SMLE_STEPS = 10
SMLE_RATE = 0.5         # each step halves the remaining error
STEPS_BEFORE = 5        # of SRT3D, before the denoiser
SHARES = 65             # values of α from 0 to 1
COVARIANCE_RIDGE = 1e-3     # of the mean variance: short IRFs give all photons of a surface the same sketch


class SMLE:
    """Reconstructs frames of one sensor from their sketches; as in the paper, every pixel with photons shows a point.

    The sketch of n photons is normally distributed around Ψ_θ with covariance Σ_θ / n. So W = Σ_θ⁻¹ is maximum
    likelihood, except for the determinant, which n outweighs. Arguments as for `Pooled`.
    """

    precise = True          # W is the inverse covariance of the sketch, else the identity

    def __init__(self, sensor: SensorModel, frequencies: Sequence[int], surfaces: int = 1, device: str = "cpu"):
        self.sensor, self._surfaces, self._matcher = sensor, surfaces, Matcher(sensor, frequencies)
        self._on_device = SensorOnDevice(self._matcher, device, surfaces)
        kernels = self.kernels = self._on_device.kernels
        self._table = kernels.array(weighted_steps(sensor, self._matcher.frequencies, self.precise))
        self._enough = kernels.array(points_needed(sensor.exposure))
        self.run = kernels.as_frame(self._frame)

    def __call__(self, sketch: PhaseSums) -> PointCloud:
        """The point cloud of one frame's sketch."""
        self._matcher.check(sketch)
        background, *listed = self.run(sketch.photons.astype(np.float32), sketch.sums)
        return self._on_device.cloud(listed, background, sketch)

    def _frame(self, photons: Array, sums: Array) -> tuple:
        """Background photons, and the list of points, all on the device."""
        data, _ = self._on_device.match(photons, sums)
        points = self._points(data, *self.kernels.match(data, self._surfaces))
        depth, intensity, exposure = (maps.crop(values, *data.shape) for values in (*points, data.exposure))
        background = (photons - (intensity * exposure[:, None]).sum(1)).clip(min=0)
        return background, *self._on_device.listed(depth % self.sensor.num_bins, intensity, depth * np.nan)

    def _points(self, frame: MatchedFrame, depth: Array, intensity: Array) -> tuple[Array, Array]:
        """Depth (bins) and intensity of the surfaces, float32 [rows', K, cols'], from a start; intensity 0: none."""
        for _ in range(SMLE_STEPS):
            depth, intensity = self.kernels.pixelwise(frame, self._table, SMLE_RATE, 0.0, depth, intensity)
        return depth, intensity

    def forget(self) -> None:
        """Nothing is kept from frame to frame."""

    def warm_up(self) -> None:
        """Compile the kernels, or load them from the disk."""
        self(noise_sketch(self.sensor, self._matcher.frequencies))


class SRT3D(SMLE):
    """As in the paper: 5 gradient steps, then 25 times [gradient step, hard threshold on intensity, APSS].

    Frequencies 1 … m and W = identity are the paper's. It tunes step sizes for each data set. Here they are half the
    inverse curvature of the data term in intensity, and a quarter in depth, where points below the mean intensity use
    that at the mean, as one step size for all pixels would.
    """

    precise = False

    def _points(self, frame: MatchedFrame, depth: Array, intensity: Array) -> tuple[Array, Array]:
        kernels, usual = self.kernels, self.kernels.usual_intensity(intensity, frame.exposure)
        for _ in range(STEPS_BEFORE):
            depth, intensity = kernels.pixelwise(frame, self._table, RATE, usual, depth, intensity)
        scale = depth_scale_bins(self.sensor, kernels.median_depth(depth, intensity), frame.resolution_bins)
        step = partial(kernels.pixelwise, frame, self._table, RATE, usual, faintest=FAINTEST * usual)
        return plug_and_play(kernels, step, depth, intensity, self._enough, scale, frame.num_bins)


def weighted_steps(sensor: SensorModel, frequencies: tuple[int, ...], precise: bool) -> np.ndarray:
    """A = (Uᵀ W U)⁻¹ Uᵀ W for every share α, which turns a residual into the errors of r · t and r.

    U has the derivatives of the expected sketch: i ω_l ĥ_l for a shift, ĥ_l for a change of intensity. A is the
    Gauss-Newton step on the data term: its gradient, divided by its curvature. Turned back by exp(−i ω_l t), residual
    and covariance depend on the share α of signal photons only, not on the depth.

    Args:
        precise: W is the inverse covariance, else the identity.

    Returns:
        float32 [SHARES, or 1 for the identity, 4, m]: weights of the real and the imaginary parts of the residual of
        `MatchedFrame.matched`, conj(ĥ_l) · sums_l, for r · t and then for r.
    """
    energy = mean_energy(irf_spectrum(sensor, frequencies))
    zero = np.zeros_like(energy)
    derivatives = np.stack([np.concatenate([zero, angular_frequencies(frequencies, sensor.num_bins) * energy]),
                            np.concatenate([energy, zero])], axis=1)                             # U, [2m, 2]
    weights = np.linalg.inv(_covariances(sensor, frequencies)) if precise else \
        np.diag(1 / np.tile(np.maximum(energy, 1e-12), 2))[None]
    scores = derivatives.T @ weights                                                             # Uᵀ W
    steps = np.linalg.solve(scores @ derivatives, scores)                                        # A, [levels, 2, 2m]
    return np.ascontiguousarray(steps.reshape(len(steps), 4, len(energy)), dtype=np.float32)


def _covariances(sensor: SensorModel, frequencies: tuple[int, ...]) -> np.ndarray:
    """Σ of conj(ĥ_l) exp(i ω_l x) of a photon x bins from its surface, for SHARES shares of signal α.

    A photon is signal with probability α, else uniform over the bins, which leaves frequencies uncorrelated. Sensors
    with an IRF per pixel use the mean IRF.

    Returns:
        float64 [SHARES, 2m, 2m], real parts first.
    """
    irf = sensor.mean_irf.astype(np.float64)
    waves = np.exp(1j * np.outer(sensor.irf_bins, angular_frequencies(frequencies, sensor.num_bins)))
    spectrum = irf @ waves
    seen = np.conj(spectrum) * waves
    parts = np.concatenate([np.real(seen), np.imag(seen)], axis=1)       # of a signal photon in each bin
    amplitude, mean = np.tile(np.abs(spectrum), 2), irf @ parts
    share = np.linspace(0, 1, SHARES)[:, None, None]
    covariance = (share * (parts.T * irf @ parts) + (1 - share) * np.diag(amplitude**2) / 2
                  - share**2 * np.outer(mean, mean))
    scale = (amplitude + 1e-6)**2           # relative to each frequency, else weak ones vanish
    variance = np.diagonal(covariance, axis1=1, axis2=2) @ (1 / scale) / len(scale)
    return covariance + np.maximum(COVARIANCE_RIDGE * variance, COVARIANCE_RIDGE**2)[:, None, None] * np.diag(scale)
