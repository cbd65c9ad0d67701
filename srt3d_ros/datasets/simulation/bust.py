"""The demo's scene: a head and shoulders of ellipsoids in front of a wall, turning, nodding and swaying."""

import numpy as np

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.errors import require

AT_M = np.array([0.0, -0.03, 2.10])     # centre of the head at rest, camera frame
PIVOT_M = np.array([0.0, 0.11, 0.03])   # the head turns about the top of the neck, figure frame
WALL_M = 2.42                           # depth of the wall, camera frame
STRIPES_PER_M = 28.0
PERIOD_S = 8.0          # after which all of it repeats

MARCH_STEPS = 24
MIN_CLOSING = 0.3                       # limits the secant step, which would jump over thin parts
HIT_M = 1e-4
NEARLY_M = 1e-3                         # grazing rays that end this close also hit
TEXTURE_BLEND_M = 0.0015                # width of the transition of reflectivity between two parts
CM = 0.01


# Parts of a figure, in its own frame: x right, y down, z away from the viewer. With x ≠ 0, a part has a mirror image at
# −x. Reflectivity is in [0, 1], 0 of what is carved from the parts before it. A seam to these is rounded in its width.
HEAD = """
# centre, cm        radii, cm         reflect. seam, cm   tilt about x, y, z, degrees
    0  -3.2   1.4     7.7   8.6   9.6     0.62      1      0    0    0    # cranium
    0   2.2  -2.2     6.6     9   6.7     0.62      3      0    0    0    # face
  3.2   6.2  -1.6     2.6   3.4   4.6     0.62      3      0    0   12    # jaw
    0   9.9  -6.3     2.1   1.5   1.7     0.62    2.5      0    0    0    # chin
  4.4     2  -5.4       2   1.3   1.9     0.62      3      0  -30  -15    # cheekbones
  2.6  -2.9  -7.7     2.8   0.9     1     0.62      2      0  -20   -2    # brow ridges
  3.1  -0.6  -9.4       2   1.3     2        0    1.6      0    0    0    # eye sockets
  3.1  -0.6 -6.75    1.35  0.85  1.15     0.66    0.2      0    0    0    # eyes
  3.1  -0.6  -7.6    0.62  0.62  0.42      0.1   0.05      0    0    0    # irises
  2.8 -2.85  -8.2     1.9   0.4   0.6     0.22    0.2      0  -22   -3    # eyebrows
    0   1.4    -9    0.95     4   1.5     0.62    1.4    -22    0    0    # bridge of the nose
    0   3.9 -10.7    1.25     1   1.3     0.62      1      0    0    0    # tip of the nose
 1.35   4.3  -9.5     0.8  0.75   1.1     0.62    0.8      0    0    0    # wings of the nose
    0   6.9  -7.6     2.9   1.9   1.5     0.62      2      0    0    0    # mouth
    0  6.55 -8.75     2.3   0.5   0.7      0.4    0.4      0    0    0    # upper lip
    0  7.55 -8.65       2   0.6  0.75      0.4   0.15      0    0    0    # lower lip
  8.1   0.6   1.6     0.9   3.4   2.2     0.62    0.8    -12  -35   12    # ears
  9.3   0.2   0.2    0.75   1.8     1        0    0.6    -12  -35   12    # their hollows
    0    12   3.2     5.3    13   5.6     0.62    1.5      0    0    0    # neck, which turns with the head
    0  -5.2     3     8.8   8.7  10.4     0.17    0.4      0    0    0    # hair
"""
TORSO = """
    0    21   4.5      13     6   6.5      0.5      1      0    0    0    # from the neck to the shoulders
 15.5  25.5     5       7   7.5     7      0.5      5      0    0    0    # shoulders
    0    32     2      17    16    10      0.5      4      0    0    0    # chest
    0  16.2   2.2     6.9   1.5   6.9      0.5      1     14    0    0    # collar
"""


class Bust:
    """A head and shoulders seen by `sensor`: a scene (scene.Scene) of one surface, 2 to 2.5 m away, in every pixel.

    It fills the 11° of `scene.default_sensor()`. It looks left and right and sways in 8 s, and nods in 4 s.

    Args:
        sensor: any with a pinhole projection and at least 2×2 pixels.
    """

    def __init__(self, sensor: SensorModel):
        require(isinstance(sensor.projection, Pinhole), "projection", sensor.projection.kind, "pinhole")
        require(min(sensor.rows, sensor.cols) >= 2, "rows × cols", f"{sensor.rows} × {sensor.cols}", "2 × 2 or more")
        self._shape = (sensor.rows, sensor.cols)
        self._rays = np.ascontiguousarray(sensor.rays.reshape(-1, 3).T, dtype=np.float32)
        self._head, self._torso = Figure(HEAD), Figure(TORSO)

    def frame(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Range (metres along the ray) and reflectivity at time `t_s`; both float32 [1, rows, cols]."""
        range_m = np.float32(WALL_M) / self._rays[2]
        reflectivity = self._wall(range_m)
        for figure, (turn, at) in zip((self._head, self._torso), _pose(t_s)):
            origin = (-at @ turn).astype(np.float32)
            rays = np.einsum("ji,jn->in", turn.astype(np.float32), self._rays)
            hit_at = figure.march(origin, rays)
            seen = np.flatnonzero(hit_at < range_m)
            points = origin[:, None] + hit_at[seen] * rays[:, seen]
            range_m[seen] = hit_at[seen]
            reflectivity[seen] = figure.reflectivity(points)
            if figure is self._torso:
                light = np.sin(2 * np.pi * STRIPES_PER_M * points[1]) > 0
                reflectivity[seen] *= np.where(light, np.float32(1.4), np.float32(0.5))
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
    """Rotation and position of the head's and the torso's frames in the camera's frame."""
    phase = 2 * np.pi * t_s / PERIOD_S
    sway, breath = np.sin(phase), np.sin(2 * phase)
    body = rotation(0, 4 * sway, 1.5 * sway)
    at = AT_M + (0.012 * sway, 0.002 * breath, 0.006 * breath)
    head = body @ rotation(7 * np.sin(2 * phase), 30 * np.sin(phase), 0)
    return (head, at + body @ PIVOT_M - head @ PIVOT_M), (body, at)


def _slope(points: np.ndarray, axis: int) -> np.ndarray:
    """The smaller difference to the two neighbours along an axis, so that depth edges give no false slope."""
    step = np.diff(points, axis=axis)
    first, last = step.take([0], axis=axis), step.take([-1], axis=axis)
    before, after = np.concatenate([first, step], axis=axis), np.concatenate([step, last], axis=axis)
    smaller = np.abs(before[2]) < np.abs(after[2])
    return np.where(smaller, before, after)


class Figure:
    """The surface of parts, lines such as those of HEAD, that are added or carved in turn; symmetric about x = 0."""

    def __init__(self, parts: str):
        table = np.loadtxt(parts.splitlines())
        centres, radii, turns = table[:, :3] * CM, table[:, 3:6] * CM, np.stack([rotation(*row[8:]) for row in table])
        to_unit = turns.transpose(0, 2, 1) / radii[..., None]
        shift = -np.einsum("pij,pj->pi", to_unit, centres)
        affine = np.concatenate([to_unit, shift[..., None]], axis=-1)               # point → unit sphere, [P, 3, 4]
        self._affine = np.ascontiguousarray(affine.transpose(1, 0, 2).reshape(-1, 4), dtype=np.float32)
        self._inverse_radii2 = (1 / radii**2).T.astype(np.float32)
        self._solid, self._seams_m = table[:, 6] > 0, table[:, 7] * CM
        self._reflectivity = table[self._solid, 6].astype(np.float32)
        reach = np.sqrt(np.einsum("pij,pj->pi", turns**2, radii**2))                # half sides of the boxes
        self._low = (centres - reach).min(axis=0).astype(np.float32)
        self._high = (centres + reach).max(axis=0).astype(np.float32)
        self._low[0] = -self._high[0]

    def march(self, origin: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Distance from `origin` (outside) along unit vectors float32 [3, N] to the first hit, +inf without one."""
        hit_at = np.full(rays.shape[1], np.inf, np.float32)
        t, leave = self._through_box(origin, rays)
        active = np.flatnonzero(t < leave)
        t, leave, rays = t[active], leave[active], rays[:, active]
        step = gap = None
        for _ in range(MARCH_STEPS):
            before, gap = gap, self.distance(origin[:, None] + t * rays)
            # Sphere tracing is slow at grazing incidence: divide by the closing speed of the gap (a secant step).
            closing = 1 if before is None else np.clip((before - gap) / step, MIN_CLOSING, 1)
            step = gap / closing
            t = t + step
            hit = np.abs(step) < HIT_M
            hit_at[active[hit]] = t[hit]
            on = ~hit & (t < leave)
            active, t, leave, rays = active[on], t[on], leave[on], rays[:, on]
            step, gap = step[on], gap[on]
            if not active.size:
                break
        near = np.abs(gap) < NEARLY_M
        hit_at[active[near]] = t[near]
        return hit_at

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance to the surface in metres, negative inside, close to exact near it; points float32 [3, N]."""
        first, *others = self._distances(points)
        for other, solid, seam_m in zip(others, self._solid[1:], self._seams_m[1:]):
            first = _rounded_min(first, other, seam_m) if solid else -_rounded_min(-first, other, seam_m)
        return first

    def reflectivity(self, points: np.ndarray) -> np.ndarray:
        """Reflectivity, float32 [N], at points on the surface, blended between the nearest parts."""
        near = np.abs(self._distances(points)[self._solid])
        weight = np.exp((near.min(axis=0) - near) / TEXTURE_BLEND_M)
        return np.einsum("p,pn->n", self._reflectivity, weight) / weight.sum(axis=0)

    def _distances(self, points: np.ndarray) -> np.ndarray:
        """Approximate distance to each part, [P, N]: u (u − 1) / |∇(u²/2)|, u the radius in units of the part's."""
        homogeneous = np.ones((4, points.shape[1]), np.float32)
        np.abs(points[0], out=homogeneous[0])
        homogeneous[1:3] = points[1:]
        # einsum instead of @: threaded BLAS is many times slower while other processes use the cores.
        squares = np.einsum("ij,jn->in", self._affine, homogeneous).reshape(3, len(self._solid), -1)
        squares *= squares
        u = np.sqrt(squares.sum(axis=0))
        slope = np.sqrt(np.einsum("apn,ap->pn", squares, self._inverse_radii2))
        return u * (u - 1) / np.maximum(slope, 1e-6)

    def _through_box(self, origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances at which rays enter and leave the bounding box; enter ≥ leave if they miss it."""
        safe = np.where(np.abs(rays) < 1e-9, np.float32(1e-9), rays)
        one = (self._low - origin)[:, None] / safe
        other = (self._high - origin)[:, None] / safe
        return np.minimum(one, other).max(axis=0), np.maximum(one, other).min(axis=0)


def rotation(x_deg: float, y_deg: float, z_deg: float) -> np.ndarray:
    """The rotation about x, then y, then z; [3, 3]."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(np.radians([x_deg, y_deg, z_deg])), np.sin(np.radians([x_deg, y_deg, z_deg]))
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def _rounded_min(a: np.ndarray, b: np.ndarray, seam_m: float) -> np.ndarray:
    """min(a, b), lowered by up to seam/4 where a ≈ b, which rounds the seam between two bodies."""
    overlap = np.maximum(np.float32(seam_m) - np.abs(a - b), 0)
    return np.minimum(a, b) - overlap * overlap * np.float32(0.25 / max(seam_m, 1e-6))
