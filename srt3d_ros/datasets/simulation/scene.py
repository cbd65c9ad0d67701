"""Scenes to simulate: the surfaces that each pixel sees. `bust.Bust` is the default scene."""

from typing import Protocol

import numpy as np

from srt3d_ros.core.sensor.model import SPEED_OF_LIGHT, SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.datasets import irf
from srt3d_ros.errors import require


class Scene(Protocol):
    """The interface of a scene."""

    def frame(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        """The scene at time `t_s`.

        Returns:
            range_m: float [S, rows, cols], metres along each pixel's ray to its surfaces in any order; NaN = none.
            reflectivity: float [S, rows, cols], 0 or more, relative strength of the returns.
        """


class StaticScene:
    """A static scene, such as a measured depth map.

    Args:
        range_m: [rows, cols] or [S, rows, cols], metres along the rays; NaN = no surface.
        reflectivity: same shape, 0 or more; or one number for all.
    """

    def __init__(self, range_m: np.ndarray, reflectivity: np.ndarray | float = 1.0):
        range_m = np.asarray(range_m, dtype=np.float32)
        require(range_m.ndim in (2, 3) and range_m.size > 0, "range_m shape", range_m.shape, "[S, rows, cols]")
        self._range_m = range_m.reshape(-1, *range_m.shape[-2:])
        reflectivity = np.asarray(reflectivity, dtype=np.float32)
        require(reflectivity.shape in ((), range_m.shape), "reflectivity shape", reflectivity.shape, f"{range_m.shape}")
        self._reflectivity = np.broadcast_to(reflectivity, range_m.shape).reshape(self._range_m.shape)

    def frame(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Range and reflectivity, the same at any time; see Scene."""
        return self._range_m, self._reflectivity


def default_sensor() -> SensorModel:
    """The sensor of the default scene: 141×141 pixels, 11°, T = 4613 bins of 0.3 mm that begin at a range of 1.5 m.

    T, bin and size are those of the head scanned by Heriot-Watt University that the SRT3D paper uses.
    """
    bin_width_s = 2 * 0.3e-3 / SPEED_OF_LIGHT
    return SensorModel(rows=141, cols=141, num_bins=4613, bin_width_s=bin_width_s, irf=irf.spad(bin_width_s),
                       toa_offset_bins=5000, projection=Pinhole.from_fov(141, 141, fov_deg=11.0))
