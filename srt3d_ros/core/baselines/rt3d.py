"""RT3D: spatially regularised reconstruction from every time of arrival.

    J. Tachella, Y. Altmann, N. Mellado, A. McCarthy, R. Tobin, G. S. Buller, J.-Y. Tourneret, S. McLaughlin, "Real-time
    3D reconstruction from single-photon lidar data using plug-and-play point cloud denoisers", Nature Communications
    10, 2019.

It maximises the Poisson likelihood of the photons, of which Σ_k g r_k h(x − t_k) + g b are expected at x. Gradient
steps on depths and log-intensities and an expectation step on the background alternate with denoisers: APSS and a hard
threshold for the points, a moving average for the background. It starts from the matched filter. The paper tunes its
step sizes; here they are half the inverse curvature in log-intensity and a quarter in depth, and for points below the
mean intensity those at the mean.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from srt3d_ros.core.baselines.plug_and_play import (
    FAINTEST,
    RATE,
    depth_scale_bins,
    plug_and_play,
    points_needed,
)
from srt3d_ros.core.baselines.xcorr import XCORR, by_pixel
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.pulse import rms_width
from srt3d_ros.core.sketching.photon_frame import PhotonEvents, PhotonFrame
from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import TINY
from srt3d_ros.kernels.devices import kernels_for

BACKGROUND_WINDOW = 1.5         # σ of the moving average, pixels
BACKGROUND_FLOOR = 0.01         # photons in a pixel: photons away from every surface need some probability


@dataclass(frozen=True, eq=False)
class Likelihood:
    """The likelihood's data and constants.

    Args:
        starts: int64 [rows · cols + 1], toa: float32 [N]: the photons by pixel, without delays.
        irf, slope: float32 [1 or rows · cols, L + 2], h and its slope h′; 0 at both ends.
        ref: index into both that marks the depth.
        information: Σ h′² / (h + b / r), Fisher's, of a signal photon on the depth, bins⁻².
        num_bins: T.
        exposure: float32 [rows, cols], g; 0 where masked.
    """

    starts: np.ndarray
    toa: np.ndarray
    irf: np.ndarray
    slope: np.ndarray
    ref: int
    information: float
    num_bins: int
    exposure: np.ndarray


class RT3D:
    """Reconstructs frames of one sensor from their photons; arguments as for `Pooled`."""

    def __init__(self, sensor: SensorModel, surfaces: int = 1):
        self.sensor, self._kernels = sensor, kernels_for("cpu")
        self._start = XCORR(sensor, surfaces)
        irf = self._irf = np.pad(np.atleast_2d(sensor.irf), [(0, 0), (1, 1)])
        self._slope = np.zeros_like(irf)
        self._slope[:, 1:-1] = (irf[:, 2:] - irf[:, :-2]) / 2
        self._width_bins = rms_width(sensor)

    def __call__(self, frame: PhotonFrame) -> PointCloud:
        """The point cloud of one frame."""
        sensor, photons, kernels = self.sensor, by_pixel(frame, self.sensor), self._kernels
        depth, intensity, background = self._start.peaks(photons)
        seen, usual = sensor.exposure, kernels.usual_intensity(intensity, sensor.exposure)
        data = self._likelihood(photons, float(background.mean()) / max(usual, 1e-6))
        smooth = self._smoother(seen)
        background = smooth(np.float32(background * seen * sensor.num_bins))

        def step(depth: np.ndarray, intensity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            background[:] = smooth(kernels.poisson(data, background, RATE, usual, depth, intensity))
            return depth, intensity * (intensity >= FAINTEST * usual)

        scale = depth_scale_bins(sensor, kernels.median_depth(depth, intensity), self._width_bins)
        depth, intensity = (maps.pad(values.swapaxes(1, 2)) for values in (depth, intensity))
        found = plug_and_play(kernels, step, depth, intensity, points_needed(seen), scale, sensor.num_bins)
        depth, intensity = (maps.crop(values, *seen.shape) for values in found)
        return PointCloud.from_layers(sensor, depth, intensity, background * seen * sensor.num_bins, frame.stamp_ns)

    def _likelihood(self, photons: PhotonEvents, ratio: float) -> Likelihood:
        """The likelihood of photons with a background per bin of `ratio` times the signal."""
        sensor = self.sensor
        toa = photons.toa - sensor.late.ravel()[photons.pixel]
        mean, slope = (values[:, 1:-1].mean(axis=0, dtype=np.float64) for values in (self._irf, self._slope))
        information = max(float((slope**2 / np.maximum(mean + ratio, TINY)).sum()), TINY)
        starts = np.searchsorted(photons.pixel, np.arange(sensor.pixels + 1, dtype=np.uint32))
        ref = 1 - int(sensor.irf_bins[0])           # the padding's bin comes first
        return Likelihood(starts, toa, self._irf, self._slope, ref, information, sensor.num_bins, sensor.exposure)

    def _smoother(self, seen: np.ndarray) -> Callable:
        """A function from background photons to their local mean per bin at a gain of 1, float32 [rows, cols]."""
        blur, least = self._kernels.blur, BACKGROUND_FLOOR * seen[:, None]
        bins = np.maximum(blur(seen[:, None], BACKGROUND_WINDOW)[:, 0] * self.sensor.num_bins, 1e-6)
        return lambda stray: blur(stray[:, None] + least, BACKGROUND_WINDOW)[:, 0] / bins

    def warm_up(self) -> None:
        """Compile the kernels, or load them from the disk."""
        self(PhotonEvents(np.zeros(1, np.uint32), np.zeros(1, np.uint16)))
