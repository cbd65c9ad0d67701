"""Where to look at a cloud from: the eye that recordings open with and pictures are drawn from. NumPy only."""

from dataclasses import dataclass

import numpy as np

from srt3d_ros.core.projection import AngularScan, Projection

_PERCENTILES = (2, 98)
_SAMPLES = 8192


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """An eye at `position` looking at `target`, `up` upwards on the screen; metres, sensor's frame, float64 [3] each.

    Args:
        fov_deg: angle of view across the picture's height.
    """

    position: np.ndarray
    target: np.ndarray
    up: np.ndarray
    fov_deg: float

    def axes(self) -> np.ndarray:
        """Unit vectors right, down and forward of the picture as the rows of [3, 3]."""
        forward = self.target - self.position
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, self.up)
        right = right / np.linalg.norm(right)
        return np.stack([right, np.cross(forward, right), forward])


def sensor_axes(projection: Projection | None) -> np.ndarray:
    """The sensor's forward, right and up directions in its own frame, rows of [3, 3]: optical frame, or REP-103."""
    if isinstance(projection, AngularScan):
        return np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, 1]])
    return np.array([[0.0, 0, 1], [1, 0, 0], [0, -1, 0]])


def look_at(xyz: np.ndarray, projection: Projection | None = None, yaw_deg: float = -30, pitch_deg: float = 15,
            fov_deg: float = 45, margin: float = 0.75) -> Viewpoint:
    """The eye from which the cloud fills the view, turned about its middle away from the sensor's line of sight.

    Args:
        xyz: float [N, 3], metres, sensor's frame; points that are not finite are left out, outliers hardly count.
        projection: the sensor's, which says where up is; an optical frame if None.
        yaw_deg: to the right of the sensor if positive.
        pitch_deg: above the sensor if positive.
        fov_deg: the eye's angle of view.
        margin: distance, relative to the one from which the cloud just fits.
    """
    forward, right, up = sensor_axes(projection)
    low, high = _box(xyz, np.stack([right, up, forward]))
    centre = ((low + high) / 2) @ np.stack([right, up, forward])
    radius = max(float(np.linalg.norm(high - low)) / 2, 1e-3)
    yaw, pitch = np.radians(yaw_deg), np.radians(pitch_deg)
    towards = np.cos(pitch) * (np.sin(yaw) * right - np.cos(yaw) * forward) + np.sin(pitch) * up
    distance = margin * radius / np.tan(np.radians(fov_deg) / 2)
    return Viewpoint(centre + distance * towards, centre, up, fov_deg)


def _box(xyz: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Low and high corner, along `axes`, of the box that most points lie in; a metre ahead for an empty cloud."""
    xyz = np.asarray(xyz, np.float64)[:: max(len(xyz) // _SAMPLES, 1)]
    xyz = xyz[np.isfinite(xyz).all(axis=1)]
    if len(xyz) == 0:
        return np.array([-0.5, -0.5, 0.5]), np.array([0.5, 0.5, 1.5])
    low, high = np.percentile(xyz @ axes.T, _PERCENTILES, axis=0)
    return low, high
