"""Figures made of ellipsoids: a signed distance field, marched by rays. The default scene is drawn with it."""

from dataclasses import dataclass

import numpy as np

MARCH_STEPS = 24
MIN_CLOSING = 0.3                       # so that a secant step never jumps over something thin
HIT_M = 1e-4
NEARLY_M = 1e-3                        # grazing rays that come this close and no closer also hit
TEXTURE_BLEND_M = 0.0015                # reflectivity passes from one part to the next over about this length
CM = 0.01


@dataclass(frozen=True)
class Part:
    """One ellipsoid of a figure, in the figure's own frame: x right, y down, z away from the viewer.

    Args:
        centre_cm, radii_cm: a part off the middle plane (`centre_cm[0]` ≠ 0) has a mirror image at −x.
        reflectivity: in [0, 1].
        seam_cm: width of the rounded seam to the parts before it.
        carve: True if the part is taken away from the parts before it.
        tilt_deg: turned about x, then y, then z.
    """

    centre_cm: tuple[float, float, float]
    radii_cm: tuple[float, float, float]
    reflectivity: float = 0.0
    seam_cm: float = 1.0
    carve: bool = False
    tilt_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Figure:
    """The surface of a table of parts, each added to or carved from the ones before it; symmetric about x = 0."""

    def __init__(self, parts: tuple[Part, ...]):
        self._parts = parts
        radii = np.array([part.radii_cm for part in parts]) * CM
        centres = np.array([part.centre_cm for part in parts]) * CM
        turns = np.stack([rotation(*part.tilt_deg) for part in parts])
        to_unit = turns.transpose(0, 2, 1) / radii[..., None]
        shift = -np.einsum("pij,pj->pi", to_unit, centres)
        affine = np.concatenate([to_unit, shift[..., None]], axis=-1)               # point → unit sphere, [P, 3, 4]
        self._affine = np.ascontiguousarray(affine.transpose(1, 0, 2).reshape(-1, 4), dtype=np.float32)
        self._inverse_radii2 = (1 / radii**2).T.astype(np.float32)
        self._solid = np.array([not part.carve for part in parts])
        self._reflectivity = np.array([part.reflectivity for part in parts], dtype=np.float32)[self._solid]
        reach = np.sqrt(np.einsum("pij,pj->pi", turns**2, radii**2))                # half sides of each part's box
        self._low = (centres - reach).min(axis=0).astype(np.float32)
        self._high = (centres + reach).max(axis=0).astype(np.float32)
        self._low[0] = -self._high[0]

    def march(self, origin: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Distance along each ray to the first hit, float32 [N], +inf where it misses.

        `rays` are unit vectors, float32 [3, N]; `origin` is their common start, [3], outside the figure.
        """
        hit_at = np.full(rays.shape[1], np.inf, np.float32)
        t, leave = self._through_box(origin, rays)
        active = np.flatnonzero(t < leave)
        t, leave, rays = t[active], leave[active], rays[:, active]
        step = gap = None
        for _ in range(MARCH_STEPS):
            before, gap = gap, self.distance(origin[:, None] + t * rays)
            # Sphere tracing crawls along grazing surfaces; dividing by how fast the gap closes (a secant) does not.
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
        for part, other in zip(self._parts[1:], others):
            if part.carve:
                first = -_rounded_min(-first, other, part.seam_cm * CM)
            else:
                first = _rounded_min(first, other, part.seam_cm * CM)
        return first

    def reflectivity(self, points: np.ndarray) -> np.ndarray:
        """Reflectivity, float32 [N], at points on the surface, blended between the nearest parts."""
        near = np.abs(self._distances(points)[self._solid])
        weight = np.exp((near.min(axis=0) - near) / TEXTURE_BLEND_M)
        return np.einsum("p,pn->n", self._reflectivity, weight) / weight.sum(axis=0)

    def _distances(self, points: np.ndarray) -> np.ndarray:
        """About the distance to each part, [P, N]: u (u − 1) / |∇(u²/2)| of u, the radius in units of the part's."""
        homogeneous = np.ones((4, points.shape[1]), np.float32)
        np.abs(points[0], out=homogeneous[0])
        homogeneous[1:3] = points[1:]
        # einsum, not @: threaded BLAS is many times slower than one thread while others use the cores.
        squares = np.einsum("ij,jn->in", self._affine, homogeneous).reshape(3, len(self._parts), -1)
        squares *= squares
        u = np.sqrt(squares.sum(axis=0))
        slope = np.sqrt(np.einsum("apn,ap->pn", squares, self._inverse_radii2))
        return u * (u - 1) / np.maximum(slope, 1e-6)

    def _through_box(self, origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where rays enter and leave the figure's box; enter ≥ leave: they miss it."""
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
    """min(a, b), lowered by up to seam/4 where they nearly meet, which rounds the seam of two bodies."""
    corner = np.abs(a - b)
    np.subtract(np.float32(seam_m), corner, out=corner)
    np.maximum(corner, 0, out=corner)
    corner *= corner
    corner *= np.float32(0.25 / max(seam_m, 1e-6))
    return np.minimum(a, b) - corner
