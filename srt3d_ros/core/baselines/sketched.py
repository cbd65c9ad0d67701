"""The published methods on sketches: SMLE and SRT3D.

    M. P. Sheehan, J. Tachella, M. E. Davies, "A sketching framework for reduced data transfer in photon counting
    lidar", IEEE Transactions on Computational Imaging 7, 2021 (SMLE).
    J. Tachella, M. P. Sheehan, M. E. Davies, "Sketched RT3D: how to reconstruct billions of photons per second",
    ICASSP 2022 (SRT3D).

Both minimise n (z − Ψ_θ)ᵀ W (z − Ψ_θ) for each pixel, SRT3D with a regularisation ρ(θ) over all pixels: by gradient
steps scaled by the inverse curvature, from a matched filter on each pixel's sketch.
"""

from functools import partial

import numpy as np

from srt3d_ros.core.baselines.plug_and_play import (
    FAINTEST,
    RATE,
    depth_scale_bins,
    plug_and_play,
    points_needed,
)
from srt3d_ros.core.baselines.weighting import weighted_steps
from srt3d_ros.core.matched_frame import MatchedFrame, Matcher
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sketching.sums import PhaseSums, noise_sketch
from srt3d_ros.kernels import maps
from srt3d_ros.kernels.devices import kernels_for

SMLE_STEPS = 10
SMLE_RATE = 0.5         # each step halves the remaining error
STEPS_BEFORE = 5        # of SRT3D, before the denoiser


class SMLE:
    """Reconstructs frames of one sensor from their sketches; as in the paper, every pixel with photons shows a point.

    The sketch of n photons is normally distributed around Ψ_θ with covariance Σ_θ / n. So W = Σ_θ⁻¹ is maximum
    likelihood, except for the determinant, which n outweighs. Arguments as for `Pooled`.
    """

    precise = True          # W is the inverse covariance of the sketch, else the identity

    def __init__(self, sensor: SensorModel, frequencies, surfaces: int = 1, device: str = "cpu"):
        self.sensor, self.surfaces, self.device, self._matcher = sensor, surfaces, device, Matcher(sensor, frequencies)
        kernels = self._kernels = kernels_for(device).for_shape(
            sensor.rows, sensor.cols, surfaces, self._matcher.frequencies)
        self._on_device = self._matcher.on(kernels)
        self._table, self._enough = map(kernels.array, (
            weighted_steps(sensor, self._matcher.frequencies, self.precise), points_needed(sensor.exposure)))
        self._run = kernels.as_frame(self._frame)

    def __call__(self, sketch: PhaseSums) -> PointCloud:
        """The point cloud of one frame's sketch."""
        self._matcher.check(sketch)
        background, *listed = self._run(sketch.photons.astype(np.float32), sketch.sums)
        return self._on_device.cloud(listed, background, sketch.stamp_ns)

    def _frame(self, photons, sums) -> tuple:
        """Background photons, and the list of points, all on the device."""
        data, _ = self._on_device.match(photons, sums)
        points = self._points(data, *self._kernels.match(data, self.surfaces))
        depth, intensity, exposure = (maps.crop(values, *data.shape) for values in (*points, data.exposure))
        background = (photons - (intensity * exposure[:, None]).sum(1)).clip(min=0)
        return background, *self._on_device.listed(depth % self.sensor.num_bins, intensity, depth * np.nan)

    def _points(self, frame: MatchedFrame, depth, intensity) -> tuple:
        """Depth (bins) and intensity of the surfaces, float32 [rows', K, cols'], from a start; intensity 0: none."""
        for _ in range(SMLE_STEPS):
            depth, intensity = self._kernels.pixelwise(frame, self._table, SMLE_RATE, 0.0, depth, intensity)
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

    def _points(self, frame: MatchedFrame, depth, intensity) -> tuple:
        kernels, usual = self._kernels, self._kernels.usual_intensity(intensity, frame.exposure)
        for _ in range(STEPS_BEFORE):
            depth, intensity = kernels.pixelwise(frame, self._table, RATE, usual, depth, intensity)
        scale = depth_scale_bins(self.sensor, kernels.median_depth(depth, intensity), frame.resolution_bins)
        step = partial(kernels.pixelwise, frame, self._table, RATE, usual, faintest=FAINTEST * usual)
        return plug_and_play(kernels, step, depth, intensity, self._enough, scale, frame.num_bins)
