"""A simulated scene with two surfaces a pixel: a net in front of a plane."""

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.datasets import irf


class NetScene:
    """A camouflage net waving in front of a plane: two surfaces in most pixels, one where it is dense or open."""

    net_m, plane_m = 2.0, 3.2           # along the optical axis

    def __init__(self, sensor: SensorModel):
        self._rays = sensor.rays.astype(np.float64)

    def frame(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Range and reflectivity of net and plane at time `t_s`; see Scene."""
        x, y, z = np.moveaxis(self._rays, -1, 0)
        u, v = x / z * self.net_m, y / z * self.net_m                 # where the ray meets the net
        wave = 0.08 * np.sin(2 * np.pi * (1.3 * u + 0.7 * v - 0.4 * t_s))
        cover = np.clip(0.5 + 0.45 * np.sin(17 * u + 2 * np.sin(9 * v)) + 0.25 * np.sin(23 * v - 5 * u), 0, 1)
        range_m = np.stack([(self.net_m + wave) / z, self.plane_m / z])
        reflectivity = np.stack([cover, 1 - cover])
        range_m[reflectivity <= 0] = np.nan
        return range_m.astype(np.float32), reflectivity.astype(np.float32)


def net_sensor() -> SensorModel:
    """A sensor for NetScene: 32×32 pixels, 10°, T = 153 bins of 37.5 mm, as the paper's camouflage data."""
    bin_width_s = 250e-12
    response = irf.spad(bin_width_s, fwhm_s=500e-12, tail_s=300e-12, tail_share=0.2)
    return SensorModel(rows=32, cols=32, num_bins=153, bin_width_s=bin_width_s, irf=response,
                       projection=Pinhole.from_fov(32, 32, fov_deg=10.0))
