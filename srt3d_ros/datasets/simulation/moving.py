"""What a moving sensor sees, as a Scene with exact depths at every instant."""

import numpy as np

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.datasets import irf
from srt3d_ros.datasets.simulation.motion_profiles import OPTICAL, Path
from srt3d_ros.datasets.simulation.room import Room


def moving_sensor(side: int = 141) -> SensorModel:
    """A sensor for `room.Room`: T = 1024 bins of 1 cm, more than the room's diagonal, and an IRF of 0.4 ns = 6 cm.

    At 1 m/s and 30°/s, 100 ms move the scene by ten bins and eight pixels.
    """
    bin_width_s = 66.7e-12
    return SensorModel(side, side, 1024, bin_width_s, irf.spad(bin_width_s, fwhm_s=400e-12, tail_s=150e-12),
                       projection=Pinhole.from_fov(side, side, 55.0))


class MovingView:
    """A scene (scene.Scene) of one surface, seen by a sensor on a moving body.

    Args:
        path: the body's motion.
        exposure_s: duration of a frame, which shows the scene at its middle. Use short frames, several a packet.
    """

    def __init__(self, world: Room, path: Path, sensor: SensorModel, exposure_s: float = 0.0):
        self.sensor, self._world, self._path, self._exposure_s = sensor, world, path, exposure_s
        self._shape = sensor.rows, sensor.cols
        self._mount = OPTICAL if isinstance(sensor.projection, Pinhole) else Pose()
        self._rays = np.ascontiguousarray(sensor.rays.reshape(-1, 3).T)

    def sensor_pose(self, t_s: float) -> Pose:
        """Pose of the frame of the sensor's rays."""
        return self._path(t_s) @ self._mount

    def at(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Range (m) and reflectivity at an instant, float32 [rows, cols] each; NaN and 0 without a surface."""
        pose = self.sensor_pose(t_s)
        rays = np.einsum("ij,jn->in", pose.rotation.astype(np.float32), self._rays)
        range_m, reflectivity = self._world.cast(pose.translation, rays)
        return range_m.reshape(self._shape), reflectivity.reshape(self._shape)

    def frame(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Range and reflectivity of the frame that begins at `t_s`; see scene.Scene."""
        range_m, reflectivity = self.at(t_s + self._exposure_s / 2)
        return range_m[None], reflectivity[None]
