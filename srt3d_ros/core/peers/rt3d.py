"""RT3D: spatially regularised reconstruction from every time of arrival.

    J. Tachella, Y. Altmann, N. Mellado, A. McCarthy, R. Tobin, G. S. Buller, J.-Y. Tourneret, S. McLaughlin, "Real-time
    3D reconstruction from single-photon lidar data using plug-and-play point cloud denoisers", Nature Communications
    10, 2019.

It maximises the Poisson likelihood of the photons, Σ_k g r_k h(x − t_k) + g b expected at x, by gradient steps on
depths and log-intensities and an expectation step on the background, in turn with denoisers: APSS and a hard threshold
for the points, a moving average for the background. The matched filter starts. The paper's step sizes are tuned; here
they are half the inverse curvature in log-intensity and a quarter of it in depth, for points weaker than the mean the
curvature at the mean.
"""

from dataclasses import dataclass

import numpy as np

from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.peers.correlation import correlate
from srt3d_ros.core.peers.fisher import DepthInformation, irf_slope
from srt3d_ros.core.peers.options import kernels_of
from srt3d_ros.core.peers.plug_and_play import FAINTEST, RATE, depth_scale_bins, plug_and_play, usual_intensity
from srt3d_ros.core.peers.toa import PixelToa, by_pixel, exposure
from srt3d_ros.core.photons import PhotonEvents, PhotonFrame
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.core.start import window_weights

BACKGROUND_WINDOW = 1.5         # σ of the moving average, pixels
LEAST_BACKGROUND = 0.01         # photons in a pixel: a photon off every surface must have come from somewhere


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Everything in the likelihood but the unknowns.

    Args:
        starts: int64 [rows · cols + 1], toa: float32 [N]: the photons by pixel, delays taken out.
        irf, slope: float32 [1 or rows · cols, L], h and h′.
        ref: index into them that marks the depth.
        information: of a signal photon on the depth, bins⁻².
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
    """Reconstructs frames of one sensor.

    Args:
        sensor: geometry, IRF and calibration.
        surfaces: K, the most surfaces in a pixel, 1 … 4.
        device: "cpu" or "auto", which is the same here.

    Raises:
        InvalidInput: for a parameter that cannot be used.
    """

    def __init__(self, sensor: SensorModel, surfaces: int = 1, device: str = "auto"):
        self.device, self.kernels = "cpu", kernels_of("rt3d", surfaces, device)
        self.sensor, self.surfaces = sensor, surfaces
        self._information = DepthInformation(sensor)
        self._irf = np.atleast_2d(sensor.irf)
        self._slope = irf_slope(self._irf).astype(np.float32)
        self._width_bins = _rms_width(self._irf.mean(axis=0))

    def __call__(self, frame: PhotonFrame) -> PointCloud:
        """The point cloud of one frame."""
        sensor, photons = self.sensor, by_pixel(frame, self.sensor)
        start = correlate(photons, sensor, self.surfaces)
        depth, intensity = start.depth, start.intensity
        usual = usual_intensity(intensity, exposure(sensor))
        data = self._likelihood(photons, float(start.background.mean()) / max(usual, 1e-6))
        background = self._smooth(start.background * data.exposure * sensor.num_bins, data.exposure)

        def step(depth, intensity):
            stray = self.kernels.poisson(data, background, RATE, usual, depth, intensity)
            background[:] = self._smooth(stray, data.exposure)

        scale = depth_scale_bins(sensor, depth, intensity, self._width_bins)
        depth, intensity = plug_and_play(step, depth, intensity, data.exposure, FAINTEST * usual, scale,
                                         sensor.num_bins, self.kernels)
        std = self._information.std(intensity * data.exposure[:, None], (background * data.exposure)[:, None])
        background = background * data.exposure * sensor.num_bins
        return PointCloud.from_layers(sensor, depth, intensity, std, background, photons.stamp_ns)

    def _likelihood(self, photons: PixelToa, ratio: float) -> Likelihood:
        """The likelihood of some photons amid a background per bin of `ratio` times the signal."""
        toa, delay = photons.toa, self.sensor.delay_bins
        if delay is not None:
            toa = toa - np.repeat(delay.ravel(), photons.counts)
        return Likelihood(photons.starts, toa, self._irf, self._slope, self.sensor.irf_ref,
                          float(self._information.per_photon(ratio)), self.sensor.num_bins, exposure(self.sensor))

    def _smooth(self, stray: np.ndarray, seen: np.ndarray) -> np.ndarray:
        """Background per bin at a gain of 1 from background photons, averaged over a window; float32 [rows, cols]."""
        weights = window_weights(BACKGROUND_WINDOW, 1)
        maps = np.stack([stray + LEAST_BACKGROUND * seen, seen], axis=1).astype(np.float32)
        pooled = self.kernels.blur(maps, weights, 1)
        return pooled[:, 0] / np.maximum(pooled[:, 1] * self.sensor.num_bins, 1e-6)

    def warm_up(self) -> None:
        """Compile the kernels, or load them from the disk, so that the first frame is as fast as the others."""
        self(PhotonEvents(np.zeros(1, np.uint32), np.zeros(1, np.uint16)))


def _rms_width(irf: np.ndarray) -> float:
    """Standard deviation of a photon's time, bins; at least one bin's."""
    bins = np.arange(len(irf))
    mean = (irf * bins).sum() / irf.sum()
    return float(np.sqrt(max((irf * (bins - mean)**2).sum() / irf.sum(), 1 / 12)))
