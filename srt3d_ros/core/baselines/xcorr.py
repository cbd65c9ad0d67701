"""XCORR: the classical matched filter on every pixel's histogram, see `correlation`.

As in the papers every pixel that saw photons shows a point, unless a false-alarm rate is given.
"""

import numpy as np

from srt3d_ros.core.baselines.correlation import correlate
from srt3d_ros.core.baselines.fisher import DepthInformation
from srt3d_ros.core.baselines.options import kernels_of
from srt3d_ros.core.baselines.toa import by_pixel, exposure
from srt3d_ros.core.cloud import PointCloud
from srt3d_ros.core.photons import PhotonFrame
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.errors import require


class XCORR:
    """Reconstructs frames of one sensor.

    Args:
        sensor: geometry, IRF and calibration.
        surfaces: K, the most surfaces in a pixel, 1 … 4.
        false_alarm_rate: probability that a pixel that sees only background shows a point; None: all points are shown.
        device: "cpu" or "auto", which is the same here.

    Raises:
        InvalidInput: for a parameter that cannot be used.
    """

    def __init__(self, sensor: SensorModel, surfaces: int = 1, false_alarm_rate: float | None = None,
                 device: str = "auto"):
        require(device in ("auto", "cpu"), "device", device, "cpu or auto: xcorr has no CUDA kernels")
        kernels_of(surfaces, "cpu", false_alarm_rate)
        self.device = "cpu"
        self.sensor, self.surfaces, self.false_alarm_rate = sensor, surfaces, false_alarm_rate
        self._information = DepthInformation(sensor)

    def __call__(self, frame: PhotonFrame) -> PointCloud:
        """The point cloud of one frame."""
        photons = by_pixel(frame, self.sensor)
        peaks = correlate(photons, self.sensor, self.surfaces)
        intensity = peaks.intensity
        if self.false_alarm_rate is not None:
            intensity = np.where(peaks.false_alarm <= self.false_alarm_rate, intensity, 0)
        seen = exposure(self.sensor)
        std = self._information.std(intensity * seen[:, None], (peaks.background * seen)[:, None])
        background = peaks.background * seen * self.sensor.num_bins
        return PointCloud.from_layers(self.sensor, peaks.depth, intensity, std, background, photons.stamp_ns)

    def warm_up(self) -> None:
        """Nothing has to be compiled."""
