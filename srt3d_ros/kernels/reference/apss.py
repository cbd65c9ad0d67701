"""Algebraic point set surfaces: `apss` of `kernels.api`."""

import numpy as np

from srt3d_ros.kernels.constants import (
    APSS_ENOUGH,
    APSS_PROJECTIONS,
    APSS_REACH,
    APSS_RIDGE,
    APSS_SAME_SURFACE,
    APSS_SHARED,
    APSS_STILL,
)
from srt3d_ros.kernels.reference.arithmetic import wrap


def apss(depth, intensity, normal, exposure, scale, num_bins):
    rows, surfaces, cols = depth.shape
    out = np.zeros(depth.shape), np.zeros(depth.shape), np.zeros((2, *depth.shape))
    for i, j in np.argwhere(exposure > 0):
        points, pixels = _neighbourhood(i, j, depth, intensity, normal, scale, num_bins)
        found = []
        for cluster in _clusters(points):
            if len(cluster) >= min(APSS_ENOUGH, pixels):
                mine, others = ([p["r"] for p in cluster if p["own"] == own] for own in (True, False))
                shared = (1 - APSS_SHARED) * sum(mine) + APSS_SHARED * (np.mean(others) if others else 0)
                found.append((shared, np.mean([p["at"][2] for p in cluster])))
        for k, (shared, z) in enumerate(sorted(found, key=lambda f: -f[0])[:surfaces]):
            for _ in range(APSS_PROJECTIONS):
                move, facing = (_plane if normal is None else _sphere)(z, points)
                z += move
                if abs(move) < APSS_STILL:
                    break
            out[0][i, k, j] = (points[0]["depth"] + z * scale) % num_bins
            out[1][i, k, j] = shared
            out[2][:, i, k, j] = facing[:2]
    return out


def _neighbourhood(i, j, depth, intensity, normal, scale, num_bins):
    """The points of the 3 × 3 pixels around (i, j), its own first, and how many pixels those are."""
    rows, surfaces, cols = depth.shape
    pixels = [(i, j)] + [(a, b) for a in range(i - 1, i + 2) for b in range(j - 1, j + 2)
                         if (a, b) != (i, j) and 0 <= a < rows and 0 <= b < cols]
    points = []
    for a, b in pixels:
        for k in np.flatnonzero(intensity[a, :, b] > 0):
            t = float(depth[a, k, b])
            z = wrap(t - (points[0]["depth"] if points else t), num_bins) / scale
            n = np.zeros(2) if normal is None else normal[:, a, k, b].astype(float)
            points.append({"at": np.array([b - j, a - i, z]), "depth": t, "r": float(intensity[a, k, b]),
                           "own": (a, b) == (i, j), "n": np.append(n, np.sqrt(1 - n @ n))})
    return points, len(pixels)


def _clusters(points):
    """Points within APSS_SAME_SURFACE of the mean of those that joined before."""
    clusters = []
    for p in points:
        near = (c for c in clusters if abs(p["at"][2] - np.mean([q["at"][2] for q in c])) < APSS_SAME_SURFACE)
        home = next(near, None)
        if home is None:
            clusters.append([p])
        else:
            home.append(p)
    return clusters


def _weighed(z, points):
    """Positions from (0, 0, z), normals, and weights (1 − d²/h²)²."""
    x = np.array([p["at"] for p in points]) - [0, 0, z]
    return x, np.array([p["n"] for p in points]), np.maximum(1 - (x**2).sum(axis=1) / APSS_REACH**2, 0)**2


def _plane(z, points):
    """Height at the centre and normal of the least-squares plane, its slopes held by a ridge."""
    x, _, w = _weighed(z, points)
    if not w.any():
        return 0.0, np.zeros(3)
    mean = w @ x / w.sum()
    spread = (w[:, None] * (x - mean)).T @ (x - mean) / w.sum()
    slopes = np.linalg.solve(spread[:2, :2] + APSS_RIDGE * np.eye(2), spread[:2, 2])
    normal = np.append(-slopes, 1)
    return mean[2] - slopes @ mean[:2], normal / np.linalg.norm(normal)


def _sphere(z, points):
    """Height at the centre and normal of the algebraic sphere u0 + u·x + uq x² whose gradient fits the normals."""
    x, n, w = _weighed(z, points)
    total = w.sum()
    if total == 0:
        return 0.0, np.zeros(3)
    square = (x**2).sum(axis=1)
    spread = w @ square - (w @ x) @ (w @ x) / total + APSS_RIDGE * total
    uq = (w @ (x * n).sum(axis=1) - (w @ x) @ (w @ n) / total) / spread / 2
    u = (w @ n - 2 * uq * (w @ x)) / total
    u0 = -(u @ (w @ x) + uq * (w @ square)) / total
    roots = np.roots([uq, u[2], u0]) if abs(uq) > 1e-12 else np.array([-u0 / u[2]])
    if np.iscomplex(roots).any():
        roots = np.array([-2 * u0 / u[2]])              # the sphere misses the line of sight
    move = float(roots[np.abs(roots).argmin()].real)
    gradient = u + 2 * uq * np.array([0, 0, move])
    gradient *= np.sign(gradient[2]) or 1
    return move, gradient / np.linalg.norm(gradient)
