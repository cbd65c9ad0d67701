"""A head and shoulders before a wall, turning, nodding and swaying: the scene of the demo."""

import numpy as np

from srt3d_ros.core.projection import Pinhole
from srt3d_ros.core.sensor import SensorModel
from srt3d_ros.datasets.figure import Figure, Part, rotation
from srt3d_ros.errors import require

SKIN, LIP, HAIR, BROW, EYE, IRIS, JERSEY = 0.62, 0.4, 0.17, 0.22, 0.66, 0.1, 0.5

HEAD = (
    Part((0, -3.2, 1.4), (7.7, 8.6, 9.6), SKIN),                                    # cranium
    Part((0, 2.2, -2.2), (6.6, 9.0, 6.7), SKIN, 3.0),                               # face
    Part((3.2, 6.2, -1.6), (2.6, 3.4, 4.6), SKIN, 3.0, tilt_deg=(0, 0, 12)),        # jaw
    Part((0, 9.9, -6.3), (2.1, 1.5, 1.7), SKIN, 2.5),                               # chin
    Part((4.4, 2.0, -5.4), (2.0, 1.3, 1.9), SKIN, 3.0, tilt_deg=(0, -30, -15)),     # cheekbones
    Part((2.6, -2.9, -7.7), (2.8, 0.9, 1.0), SKIN, 2.0, tilt_deg=(0, -20, -2)),     # brow ridges
    Part((3.1, -0.6, -9.4), (2.0, 1.3, 2.0), seam_cm=1.6, carve=True),              # eye sockets
    Part((3.1, -0.6, -6.75), (1.35, 0.85, 1.15), EYE, 0.2),                         # eyes
    Part((3.1, -0.6, -7.6), (0.62, 0.62, 0.42), IRIS, 0.05),                        # irises
    Part((2.8, -2.85, -8.2), (1.9, 0.4, 0.6), BROW, 0.2, tilt_deg=(0, -22, -3)),  # eyebrows
    Part((0, 1.4, -9.0), (0.95, 4.0, 1.5), SKIN, 1.4, tilt_deg=(-22, 0, 0)),        # bridge of the nose
    Part((0, 3.9, -10.7), (1.25, 1.0, 1.3), SKIN, 1.0),                             # tip of the nose
    Part((1.35, 4.3, -9.5), (0.8, 0.75, 1.1), SKIN, 0.8),                           # wings of the nose
    Part((0, 6.9, -7.6), (2.9, 1.9, 1.5), SKIN, 2.0),                               # mouth
    Part((0, 6.55, -8.75), (2.3, 0.5, 0.7), LIP, 0.4),                              # upper lip
    Part((0, 7.55, -8.65), (2.0, 0.6, 0.75), LIP, 0.15),                            # lower lip
    Part((8.1, 0.6, 1.6), (0.9, 3.4, 2.2), SKIN, 0.8, tilt_deg=(-12, -35, 12)),     # ears
    Part((9.3, 0.2, 0.2), (0.75, 1.8, 1.0), seam_cm=0.6, carve=True, tilt_deg=(-12, -35, 12)),  # their hollows
    Part((0, 12.0, 3.2), (5.3, 13.0, 5.6), SKIN, 1.5),                              # neck, which turns with the head
    Part((0, -5.2, 3.0), (8.8, 8.7, 10.4), HAIR, 0.4),                              # hair
)

TORSO = (
    Part((0, 21.0, 4.5), (13.0, 6.0, 6.5), JERSEY),                                 # from the neck to the shoulders
    Part((15.5, 25.5, 5.0), (7.0, 7.5, 7.0), JERSEY, 5.0),                          # shoulders
    Part((0, 32.0, 2.0), (17.0, 16.0, 10.0), JERSEY, 4.0),                          # chest
    Part((0, 16.2, 2.2), (6.9, 1.5, 6.9), JERSEY, 1.0, tilt_deg=(14, 0, 0)),        # collar
)

AT_M = np.array([0.0, -0.03, 2.10])     # centre of the head at rest, camera frame
PIVOT_M = np.array([0.0, 0.11, 0.03])   # the head turns about the top of the neck, figure frame
WALL_M = 2.42                           # depth of the wall, camera frame
STRIPES_PER_M = 28.0


class Bust:
    """A person from the shoulders up who looks left and right, nods and sways, seen by `sensor`.

    A scene (scene.Scene) of one surface, 2 to 2.5 m away, that fills the 11° of `scene.default_sensor()`; every pixel
    sees something. Periods: 8 s to look left and right, 4 s to nod, 5 s to sway.

    Args:
        sensor: any with a pinhole projection and at least 2×2 pixels.
    """

    def __init__(self, sensor: SensorModel):
        require(isinstance(sensor.projection, Pinhole), "projection", sensor.projection.kind, "pinhole, for this scene")
        require(min(sensor.rows, sensor.cols) >= 2, "rows × cols", f"{sensor.rows} × {sensor.cols}", "2 × 2 or more")
        self._shape = (sensor.rows, sensor.cols)
        self._rays = np.ascontiguousarray(sensor.rays.reshape(-1, 3).T, dtype=np.float32)
        self._head, self._torso = Figure(HEAD), Figure(TORSO)

    def frame(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Range (metres along the ray) and reflectivity at time `t_s`; both float32 [1, rows, cols]."""
        range_m = np.float32(WALL_M) / self._rays[2]
        reflectivity = self._wall(range_m)
        for figure, texture, (turn, at) in zip((self._head, self._torso), (_plain, _stripes), _pose(t_s)):
            origin = (-at @ turn).astype(np.float32)
            rays = np.einsum("ji,jn->in", turn.astype(np.float32), self._rays)
            hit_at = figure.march(origin, rays)
            seen = np.flatnonzero(hit_at < range_m)
            points = origin[:, None] + hit_at[seen] * rays[:, seen]
            range_m[seen] = hit_at[seen]
            reflectivity[seen] = figure.reflectivity(points) * texture(points)
        range_m = range_m.reshape(self._shape)
        shade = 0.25 + 0.75 * self._cosine(range_m)
        return range_m[None], (reflectivity.reshape(self._shape) * shade)[None]

    def _wall(self, range_m: np.ndarray) -> np.ndarray:
        x, y, _ = self._rays * range_m
        joint = (np.abs((x / 0.09 + 0.5) % 1 - 0.5) < 0.03) | (np.abs((y / 0.09 + 0.5) % 1 - 0.5) < 0.03)
        return np.where(joint, np.float32(0.3), np.float32(0.45))

    def _cosine(self, range_m: np.ndarray) -> np.ndarray:
        """Cosine of the angle between ray and surface, from differences of neighbouring points."""
        rays = self._rays.reshape(3, *self._shape)
        points = rays * range_m
        normal = np.cross(_slope(points, 2), _slope(points, 1), axis=0)
        return np.abs((normal * rays).sum(axis=0)) / np.maximum(np.sqrt((normal**2).sum(axis=0)), 1e-12)


def _pose(t_s: float) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """Rotation and place of the head's and the torso's frames in the camera's frame."""
    sway, breath = np.sin(2 * np.pi * t_s / 5.0), np.sin(2 * np.pi * t_s / 3.5)
    body = rotation(0, 4 * sway, 1.5 * sway)
    at = AT_M + (0.012 * sway, 0.002 * breath, 0.006 * breath)
    head = body @ rotation(7 * np.sin(2 * np.pi * t_s / 4.0), 30 * np.sin(2 * np.pi * t_s / 8.0), 0)
    return (head, at + body @ PIVOT_M - head @ PIVOT_M), (body, at)


def _plain(points: np.ndarray) -> float:
    return 1.0


def _stripes(points: np.ndarray) -> np.ndarray:
    return np.where(np.sin(2 * np.pi * STRIPES_PER_M * points[1]) > 0, np.float32(1.4), np.float32(0.5))


def _slope(points: np.ndarray, axis: int) -> np.ndarray:
    """The smaller of the differences to the two neighbours along an axis, so that depth edges give no false slope."""
    step = np.diff(points, axis=axis)
    first, last = step.take([0], axis=axis), step.take([-1], axis=axis)
    before, after = np.concatenate([first, step], axis=axis), np.concatenate([step, last], axis=axis)
    smaller = np.abs(before[2]) < np.abs(after[2])
    return np.where(smaller, before, after)
