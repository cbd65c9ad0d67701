"""A sensor that moves: what it sees on its way, as a Scene, and photons whose truth is exact at every instant."""

import numpy as np

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.datasets import irf
from srt3d_ros.datasets.simulation.motion_profiles import OPTICAL, Path
from srt3d_ros.datasets.simulation.room import Room


def moving_sensor(side: int = 141) -> SensorModel:
    """A sensor for `room.Room`: T = 1024 bins of 1 cm, which its diagonal fits in, and a response 0.4 ns = 6 cm wide.

    What 100 ms at 1 m/s and 30°/s do, 10 cm and 3°, is as much as ten bins and eight pixels.
    """
    bin_width_s = 66.7e-12
    return SensorModel(side, side, 1024, bin_width_s, irf.spad(bin_width_s, fwhm_s=400e-12, tail_s=150e-12),
                       projection=Pinhole.from_fov(side, side, 55.0))


class MovingView:
    """What a moving sensor sees: a scene (scene.Scene) of one surface.

    Args:
        path: of the body that carries the sensor.
        exposure_s: of a frame: what is seen is what is seen in the middle of it. Take frames so short that they smear
            little, several for each packet.
    """

    def __init__(self, world: Room, path: Path, sensor: SensorModel, exposure_s: float = 0.0):
        self.sensor, self._world, self._path, self._exposure_s = sensor, world, path, exposure_s
        self._shape = sensor.rows, sensor.cols
        self._mount = OPTICAL if isinstance(sensor.projection, Pinhole) else Pose()
        self._rays = np.ascontiguousarray(sensor.rays.reshape(-1, 3).T)

    def sensor_pose(self, t_s: float) -> Pose:
        """Of the frame of the sensor's rays, at an instant."""
        return self._path(t_s) @ self._mount

    def at(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Range (m) and reflectivity seen at an instant, float32 [rows, cols] each; NaN and 0 where nothing is."""
        pose = self.sensor_pose(t_s)
        rays = np.einsum("ij,jn->in", pose.rotation.astype(np.float32), self._rays)
        range_m, reflectivity = self._world.cast(pose.translation, rays)
        return range_m.reshape(self._shape), reflectivity.reshape(self._shape)

    def frame(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        """What a frame that begins at `t_s` sees; see scene.Scene."""
        range_m, reflectivity = self.at(t_s + self._exposure_s / 2)
        return range_m[None], reflectivity[None]
