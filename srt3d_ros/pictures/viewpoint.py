"""Choose the viewpoint of a cloud and the size of its points, for recordings and pictures."""

from dataclasses import dataclass

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import AngularScan, Projection

# Forward, right and up, as rows: ahead in a frame with z up (REP-103); and down on it, as on a map, x to the right.
LEVEL, FROM_ABOVE = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, 1]]), np.array([[0.0, 0, -1], [1, 0, 0], [0, 1, 0]])
_PERCENTILES = (0.5, 99.5)      # points outside count as outliers
_FITTING_STEPS = 4              # each step leaves a few per cent of the error
_MARGIN = 1.1                   # size of the view over that of the cloud
_SHORTEST_M = 1e-3
_MOST_POINTS = 8192
_RADIUS_PER_PITCH = 0.6         # discs of neighbouring pixels just overlap


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """An eye at `position` that looks at `target`, `up` on the screen; metres, sensor's frame, float64 [3] each."""

    position: np.ndarray
    target: np.ndarray
    up: np.ndarray
    fov_deg: float          # across the picture's smaller side

    def axes(self) -> np.ndarray:
        """Unit vectors right, down and forward as rows of [3, 3]."""
        forward = self.target - self.position
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, self.up)
        right = right / np.linalg.norm(right)
        return np.stack([right, np.cross(forward, right), forward])


def sensor_axes(projection: Projection | None) -> np.ndarray:
    """Forward, right and up in the sensor's frame (optical, or REP-103 for a scan) as rows of [3, 3]."""
    if isinstance(projection, AngularScan):
        return LEVEL
    return np.array([[0.0, 0, 1], [1, 0, 0], [0, -1, 0]])


def look_at(xyz: np.ndarray, projection: Projection | None = None, yaw_deg: float = 15, pitch_deg: float = 10,
            fov_deg: float = 30, aspect: float = 1.0, axes: np.ndarray | None = None) -> Viewpoint:
    """An eye for which the cloud fills the view, turned around its middle from the sensor's line of sight.

    Args:
        xyz: float [N, 3], metres, sensor's frame; NaN and Inf are skipped, outliers may be out of view.
        projection: the sensor's, which defines up; an optical frame if None.
        yaw_deg, pitch_deg: positive to the right of and above the sensor.
        fov_deg: the eye's angle of view.
        aspect: width over height of the view.
        axes: forward, right and up of points that are not in the sensor's frame, as rows of [3, 3].
    """
    forward, right, up = sensor_axes(projection) if axes is None else axes
    yaw, pitch = np.radians(yaw_deg), np.radians(pitch_deg)
    towards = np.cos(pitch) * (np.sin(yaw) * right - np.cos(yaw) * forward) + np.sin(pitch) * up
    xyz = _some_points(xyz, forward)
    half = _MARGIN**-1 * np.tan(np.radians(fov_deg) / 2) * np.array([max(aspect, 1), max(1 / aspect, 1)])
    low, high = np.percentile(xyz, _PERCENTILES, axis=0)
    target, distance = (low + high) / 2, max(2 * float(np.linalg.norm(high - low)), _SHORTEST_M)
    for _ in range(_FITTING_STEPS):
        eye = Viewpoint(target + distance * towards, target, up, fov_deg)
        low, high = np.percentile(_tangents(xyz, eye), _PERCENTILES, axis=0)
        target = target + distance * ((low + high) / 2 @ eye.axes()[:2])
        distance = max(distance * float(((high - low) / 2 / half).max()), _SHORTEST_M)
    return Viewpoint(target + distance * towards, target, up, fov_deg)


def _tangents(xyz: np.ndarray, eye: Viewpoint) -> np.ndarray:
    """Tangents of the angles right and down of points seen from `eye`, [N, 2], limited to 45° beside or behind it."""
    right, down, forward = ((xyz - eye.position) @ eye.axes().T).T
    return np.stack([right, down], axis=1) / np.maximum(forward, np.hypot(right, down))[:, None]


def _some_points(xyz: np.ndarray, forward: np.ndarray) -> np.ndarray:
    """A sample of the finite points, float64; two points a metre ahead for an empty cloud."""
    xyz = np.asarray(xyz, np.float64)[:: max(len(xyz) // _MOST_POINTS, 1)]
    xyz = xyz[np.isfinite(xyz).all(axis=1)]
    return xyz if len(xyz) else np.stack([forward - 0.5, forward + 0.5])


def pixel_pitch_rad(sensor: SensorModel) -> float:
    """Angle between neighbouring pixels in the middle of the array, the larger of the two directions."""
    across, along = sensor.rays[sensor.rows // 2], sensor.rays[:, sensor.cols // 2]
    return max((float(np.linalg.norm(np.diff(line, axis=0), axis=1).mean()) for line in (across, along)
                if len(line) > 1), default=0.0)


def point_radius_m(xyz: np.ndarray, sensor: SensorModel) -> float:
    """Radius of points that closes a surface at the cloud's median range; 0 for an empty cloud."""
    if len(xyz) == 0:
        return 0.0
    return _RADIUS_PER_PITCH * pixel_pitch_rad(sensor) * float(np.nanmedian(np.linalg.norm(xyz, axis=1)))
