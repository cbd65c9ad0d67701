"""Cast rays from any pose in a furnished room with two busts."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from srt3d_ros.core.motion.trajectory import Pose
from srt3d_ros.datasets.simulation.bust import HEAD, TORSO, Figure

LEAST_RAY = np.float32(1e-9)
SLOPE_M = 1e-3                  # step over which the normal of a figure is measured
Hits = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class Box:
    """A box on level ground: middle and size in metres, turned to the left by yaw."""

    middle: np.ndarray          # [3]
    size: np.ndarray            # [3]
    yaw_deg: float
    reflectivity: float
    check_m: float              # side of the texture's squares


WALLS = Box(np.array([0, 0, 1.4]), np.array([7.0, 6.0, 2.8]), 0, 0.45, 0.5)      # seen from within
FURNITURE = [Box(row[:3], row[3:6], *row[6:].tolist()) for row in np.loadtxt("""
# middle, m         size, m           yaw, degrees; reflectivity; check, m
 3.15    -1  0.45     0.7   1.4   0.9      0   0.6   0.2    # chest of drawers
  3.3   1.2   1.1     0.4   0.9   2.2      0  0.35   0.3    # shelf
  2.7   2.4   1.4    0.35  0.35   2.8     30   0.7   0.2    # pillar
  0.9  2.72   0.4     1.6  0.55   0.8      0  0.55   0.2    # bench
 -1.1  2.85   1.6     1.1   0.3     1      0  0.25   0.2    # cupboard on the wall
 -2.9   2.2   0.5     0.8   0.8     1     20   0.6   0.2    # crate
 -3.2   0.3  0.37     0.6   1.8  0.74      0   0.4   0.2    # sideboard
-3.35  -1.6  1.25     0.3   0.8   2.5      0  0.65  0.25    # cabinet
 -2.2  -2.6   0.3     0.9   0.6   0.6    -15   0.5   0.2    # box
  2.3 -2.55   0.9     0.6   0.6   1.8     40  0.45   0.2    # locker
    0 -2.75  0.55     0.4   0.4   1.1      0   0.5   0.2    # pedestal of a bust
 -3.2   0.3  0.92     0.4   0.4  0.36      0   0.7   0.2    # pedestal of a bust
    0     0  0.35     0.6   0.6   0.7     45  0.55   0.2    # table in the middle
""".splitlines())]
BUSTS = ((0.0, -2.7, 1.5, 80.0), (-3.2, 0.3, 1.5, -15.0))                       # x, y, z of the head; yaw of its gaze


class Room:
    """A room of 7 × 6 × 2.8 m with furniture along its walls and two busts; in the frame of motion_profiles."""

    def __init__(self):
        self._head, self._torso = Figure(HEAD), Figure(TORSO)

    def cast(self, origin: np.ndarray, rays: np.ndarray) -> Hits:
        """Metres along rays to the first hit, and its reflectivity; float32 [N] each.

        Args:
            origin: float [3], metres, in the free space of the room.
            rays: float32 [3, N], unit vectors.
        """
        origin = np.asarray(origin, np.float64)
        range_m, reflectivity = _cast_box(WALLS, origin, rays, within=True)
        bodies = [(box.middle, np.linalg.norm(box.size) / 2, partial(_cast_box, box)) for box in FURNITURE]
        for x, y, z, yaw_deg in BUSTS:
            pose = _facing(np.array([x, y, z]), np.radians(yaw_deg))
            bodies += [((x, y, z), 0.22, partial(_cast_figure, self._head, pose)),
                       ((x, y, z - 0.3), 0.37, partial(_cast_figure, self._torso, pose))]
        for middle, radius_m, cast in bodies:
            near = _near(np.subtract(middle, origin), radius_m, rays)
            if not near.size:
                continue
            its_range_m, its_reflectivity = cast(origin, rays[:, near])
            first = its_range_m < range_m[near]
            range_m[near[first]], reflectivity[near[first]] = its_range_m[first], its_reflectivity[first]
        return range_m, reflectivity


def _near(way: np.ndarray, radius_m: float, rays: np.ndarray) -> np.ndarray:
    """Indices of the rays that hit a ball whose centre is `way` from their origin."""
    distance = float(np.linalg.norm(way))
    if distance <= radius_m:
        return np.arange(rays.shape[1])
    along = np.einsum("i,in->n", (way / distance).astype(np.float32), rays)
    return np.flatnonzero(along > np.sqrt(1 - (radius_m / distance)**2))


def _cast_box(box: Box, origin: np.ndarray, rays: np.ndarray, within: bool = False) -> Hits:
    """Where rays enter a box, +inf if they miss it; with `within`, where they leave it."""
    half = (box.size / 2).astype(np.float32)[:, None]
    turn = Pose.turned([0, 0, np.radians(box.yaw_deg)]).rotation
    start = ((origin - box.middle) @ turn).astype(np.float32)[:, None]
    rays = rays if not box.yaw_deg else np.einsum("ji,jn->in", turn.astype(np.float32), rays)
    inverse = 1 / np.where(np.abs(rays) < LEAST_RAY, np.copysign(LEAST_RAY, rays), rays)
    side = np.copysign(half, rays)
    far_at = (side - start) * inverse
    leave_at = np.minimum(np.minimum(far_at[0], far_at[1]), far_at[2])
    if within:
        return leave_at, _shade(box, start, rays, far_at, leave_at).astype(np.float32)
    near_at = (-side - start) * inverse
    enter_at = np.maximum(np.maximum(near_at[0], near_at[1]), near_at[2])
    hit = np.flatnonzero((enter_at > 0) & (enter_at < leave_at))
    range_m, reflectivity = np.full(len(enter_at), np.inf, np.float32), np.zeros(len(enter_at), np.float32)
    range_m[hit] = enter_at[hit]
    reflectivity[hit] = _shade(box, start, rays[:, hit], near_at[:, hit], enter_at[hit])
    return range_m, reflectivity


def _shade(box: Box, start: np.ndarray, rays: np.ndarray, faces_at: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Reflectivity of a box at distance `at` [N], where faces_at [3, N] is that of its planes: checks, and shading."""
    squares = np.floor((start + at * rays) * np.float32(1 / box.check_m) + np.float32(0.25))
    face = faces_at == at
    odd = (squares.sum(axis=0) - (squares * face).sum(axis=0)) % 2      # of the two coordinates within the face
    cosine = np.abs(rays * face).max(axis=0)
    return box.reflectivity * (1.2 - 0.5 * odd) * (0.25 + 0.75 * cosine)


def _facing(middle: np.ndarray, yaw: float) -> Pose:
    """Pose of a figure's frame (x right, y down, z away from the viewer) that looks towards `yaw`."""
    away, down = -np.array([np.cos(yaw), np.sin(yaw), 0]), np.array([0.0, 0, -1])
    return Pose(np.stack([np.cross(down, away), down, away], axis=1), middle)


def _cast_figure(figure: Figure, pose: Pose, origin: np.ndarray, rays: np.ndarray) -> Hits:
    """Where rays meet a figure, +inf if they miss it."""
    turn = pose.rotation.astype(np.float32)
    start = pose.inverse()(origin).astype(np.float32)
    rays = np.einsum("ji,jn->in", turn, rays)
    range_m, reflectivity = figure.march(start, rays), np.zeros(rays.shape[1], np.float32)
    seen = np.flatnonzero(np.isfinite(range_m))
    points, rays = start[:, None] + range_m[seen] * rays[:, seen], rays[:, seen]
    here = figure.distance(points)
    steps = SLOPE_M * np.eye(3, dtype=np.float32)[:, :, None]
    slope = np.stack([figure.distance(points + step) - here for step in steps])
    cosine = np.abs((slope * rays).sum(axis=0)) / np.maximum(np.sqrt((slope**2).sum(axis=0)), LEAST_RAY)
    reflectivity[seen] = figure.reflectivity(points) * (0.25 + 0.75 * cosine)
    return range_m, reflectivity
