"""Depth maps as worlds that a shaking hand moves before, and the exact trajectory of a motion."""

from pathlib import Path as FilePath

import numpy as np

from srt3d_ros.core.motion.trajectory import Pose, Trajectory
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.datasets.simulation.motion_profiles import OPTICAL, SPEED_M_S, TURN_RAD_S, Path, measured
from srt3d_ros.datasets.simulation.room import Hits
from srt3d_ros.errors import require
from srt3d_ros.files.array_files import read_npz_arrays

SHAKE_RAD_S = 2 * np.pi                 # of a hand: once a second
MARCH_STEPS, BISECTIONS = 96, 12


def hand(t_s: float) -> Pose:
    """A hand that shakes about the origin: 1 m/s and 30°/s at every instant, within 0.16 m and 4.8°."""
    cosine, sine = np.cos(SHAKE_RAD_S * t_s), np.sin(SHAKE_RAD_S * t_s)
    turn = TURN_RAD_S / SHAKE_RAD_S * np.array([0, cosine, sine])       # of the speed named, to 0.1 %
    place = SPEED_M_S / SHAKE_RAD_S * np.array([cosine, 0.8 * sine, 0.6 * sine])
    return Pose(Pose.turned(turn).rotation, place)


def trajectory(path: Path, first_s: float, last_s: float) -> Trajectory:
    """What `measured` gives from before first_s to after last_s, as the sketcher follows it; stamps are ns from 0 s."""
    known, margin_s = Trajectory(), 0.1        # longer than a period
    for report in measured(path, start_s=first_s - margin_s):
        known.add(round(report.at_s * 1e9), report.pose)
        if report.at_s > last_s + margin_s:
            return known


class Relief:
    """The surface of a depth map, without gaps, seen from poses about that of its camera: the origin, looking along x.

    Args:
        range_m: float [rows, cols], metres along the rays of a pinhole camera.
        reflectivity: the same shape.
        valid: bool, the same shape: elsewhere nothing returns light.
        fov_deg: of the camera's larger side; scenes are stretched to it.
    """

    def __init__(self, range_m: np.ndarray, reflectivity: np.ndarray, valid: np.ndarray, fov_deg: float = 75.0):
        self._range_m = np.asarray(range_m, np.float32)
        require(bool(np.isfinite(self._range_m).all()), "range_m", "unknown in places", "finite: see `valid`")
        self._reflectivity = np.where(valid, reflectivity, np.nan).astype(np.float32)
        self._camera = Pinhole.from_fov(*self._range_m.shape, fov_deg=fov_deg)

    def cast(self, origin: np.ndarray, rays: np.ndarray) -> Hits:
        """See Room: march in even steps to the first crossing, then halve the interval. NaN outside of the map."""
        start = (origin @ OPTICAL.rotation).astype(np.float32)[:, None]
        rays = np.einsum("ji,jn->in", OPTICAL.rotation.astype(np.float32), rays)
        moved = float(np.linalg.norm(start))
        first, last = max(self._range_m.min() - moved, 0) * 0.95, self._range_m.max() * 1.05 + moved
        step = np.float32((last - first) / MARCH_STEPS)
        near = np.full(rays.shape[1], first, np.float32)
        going = np.arange(len(near))
        for _ in range(MARCH_STEPS):
            going = going[self._gap(start + (near[going] + step) * rays[:, going]) > 0]
            near[going] += step
        half = np.full(len(near), step / 2, np.float32)
        for _ in range(BISECTIONS):
            middle = near + half
            near = np.where(self._gap(start + middle * rays) > 0, middle, near)
            half /= 2
        row, col = self._places(start + near * rays)
        inside = (row >= 0) & (row <= self._range_m.shape[0] - 1) & (col >= 0) & (col <= self._range_m.shape[1] - 1)
        inside[going] = False
        row, col = (np.where(inside, place, 0).round().astype(int) for place in (row, col))
        reflectivity = np.where(inside, self._reflectivity[row, col], np.nan)
        seen = np.isfinite(reflectivity)
        return np.where(seen, near + half, np.nan).astype(np.float32), np.where(seen, reflectivity, 0)

    def _places(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Row and column of points [3, N] in the map."""
        depth = np.maximum(points[2], np.float32(1e-3))
        camera = self._camera
        return (points[1] / depth * np.float32(camera.fy) + np.float32(camera.cy),
                points[0] / depth * np.float32(camera.fx) + np.float32(camera.cx))

    def _gap(self, points: np.ndarray) -> np.ndarray:
        """How far points [3, N] lie before the surface, bilinear between pixels, even beyond the map's edge."""
        rows, cols = self._range_m.shape
        row, col = self._places(points)
        row, col = np.clip(row, 0, rows - 1.001), np.clip(col, 0, cols - 1.001)
        top, left = row.astype(np.int32), col.astype(np.int32)
        down, right = row - top, col - left
        at, flat = top * cols + left, self._range_m.reshape(-1)
        upper = flat[at] * (1 - right) + flat[at + 1] * right
        lower = flat[at + cols] * (1 - right) + flat[at + cols + 1] * right
        return upper * (1 - down) + lower * down - np.sqrt((points**2).sum(axis=0))


def read_relief(path: str | FilePath) -> Relief:
    """The world of an .npz file: `depth_m`, metres along the rays, `reflectivity` and `valid`, as Relief has them."""
    arrays = read_npz_arrays(FilePath(path), ("depth_m", "reflectivity", "valid"), "scene")
    require(len(arrays) == 3, "scene", f"with {', '.join(arrays)}", "depth_m, reflectivity and valid")
    return Relief(arrays["depth_m"], arrays["reflectivity"], arrays["valid"].astype(bool))
