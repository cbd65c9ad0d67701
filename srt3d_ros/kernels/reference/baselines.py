"""The baselines' kernels, of `kernels.api`: `pixelwise`, `poisson` and `apss`."""

import numpy as np

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.reference.arithmetic import angular, expected, pixel_z, wrap


def pixelwise(frame, table, rate, usual, depth, intensity):
    omega, levels = angular(frame), len(table)
    before_depth, before_intensity = depth.astype(float), intensity.astype(float)
    for i, k, j in np.argwhere(before_intensity > 0):
        g = float(frame.exposure[i, j])
        points = zip(before_depth[i, :, j], before_intensity[i, :, j])
        rest = pixel_z(frame.matched, i, j) - sum(expected(g * r, t, frame) for t, r in points)
        t, r = before_depth[i, k, j], before_intensity[i, k, j]
        d = rest * np.exp(-1j * omega * t)
        share = min(g * r / max(frame.counts[i, j], 1), 1)
        weights = table[int(share * (levels - 1) + 0.5)].astype(float)
        shift = weights[0] @ d.real + weights[1] @ d.imag
        change = weights[2] @ d.real + weights[3] @ d.imag
        grown = r + constants.INTENSITY_RATE * change / g
        signal = g * max(r, grown)
        step = rate * shift * signal / max(signal, usual * g)**2
        depth[i, k, j] = (t + np.clip(step, -frame.resolution_bins, frame.resolution_bins)) % frame.num_bins
        intensity[i, k, j] = max(grown, 0)


def poisson(frame, background, rate, usual, depth, intensity):
    stray = np.zeros(background.shape)
    surfaces, cols = depth.shape[1:]
    for i, j in np.argwhere(frame.exposure > 0):
        p, g = i * cols + j, float(frame.exposure[i, j])
        own = p if len(frame.irf) > 1 else 0
        t, r = depth[i, :, j].astype(float), intensity[i, :, j].astype(float)
        signal, score = np.zeros(surfaces), np.zeros(surfaces)
        for x in frame.toa[frame.starts[p]:frame.starts[p + 1]].astype(float):
            lit = np.array([irf_at(x - t[k] + frame.ref, frame.irf[own], frame.slope[own], frame.num_bins)
                            if r[k] > 0 else (0, 0) for k in range(surfaces)])
            total = background[i, j] + r @ lit[:, 0]
            stray[i, j] += background[i, j] / total
            signal += r * lit[:, 0] / total
            score -= r * lit[:, 1] / total
        for k in np.flatnonzero(r > 0):
            reach = 1 / np.sqrt(frame.information)
            step = rate * score[k] / (max(signal[k], usual * g) * frame.information)
            depth[i, k, j] = (t[k] + np.clip(step, -reach, reach)) % frame.num_bins
            change = constants.INTENSITY_RATE * (signal[k] - g * r[k]) / max(g * r[k], usual * g)
            intensity[i, k, j] = r[k] * np.exp(min(change, 1))
    return stray


def irf_at(place, irf, slope, num_bins):
    """h and h′ between entries, which lie on a circle of T bins."""
    entries = np.zeros((2, num_bins))
    entries[:, :len(irf)] = irf, slope
    low = int(np.floor(place))
    part = place - low
    return (1 - part) * entries[:, low % num_bins] + part * entries[:, (low + 1) % num_bins]


def apss(depth, intensity, normal, exposure, scale, num_bins):
    surfaces = depth.shape[1]
    out = np.zeros(depth.shape), np.zeros(depth.shape), np.zeros((2, *depth.shape))
    for i, j in np.argwhere(exposure > 0):
        points, pixels = _neighbourhood(i, j, depth, intensity, normal, scale, num_bins)
        found = []
        for cluster in _clusters(points):
            if len(cluster) >= min(constants.APSS_ENOUGH, pixels):
                mine, others = ([p["r"] for p in cluster if p["own"] == own] for own in (True, False))
                mean = np.mean(others) if others else 0
                shared = (1 - constants.APSS_SHARED) * sum(mine) + constants.APSS_SHARED * mean
                found.append((shared, np.mean([p["at"][2] for p in cluster])))
        for k, (shared, z) in enumerate(sorted(found, key=lambda f: -f[0])[:surfaces]):
            for _ in range(constants.APSS_PROJECTIONS):
                move, facing = (_plane if normal is None else _sphere)(z, points)
                z += move
                if abs(move) < constants.APSS_STILL:
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
        near = (c for c in clusters if abs(p["at"][2] - np.mean([q["at"][2] for q in c])) < constants.APSS_SAME_SURFACE)
        home = next(near, None)
        if home is None:
            clusters.append([p])
        else:
            home.append(p)
    return clusters


def _weighed(z, points):
    """Positions from (0, 0, z), normals, and weights (1 − d²/h²)²."""
    x = np.array([p["at"] for p in points]) - [0, 0, z]
    return x, np.array([p["n"] for p in points]), np.maximum(1 - (x**2).sum(axis=1) / constants.APSS_REACH**2, 0)**2


def _plane(z, points):
    """Height at the centre and normal of the least-squares plane, its slopes held by a ridge."""
    x, _, w = _weighed(z, points)
    if not w.any():
        return 0.0, np.zeros(3)
    mean = w @ x / w.sum()
    spread = (w[:, None] * (x - mean)).T @ (x - mean) / w.sum()
    slopes = np.linalg.solve(spread[:2, :2] + constants.APSS_RIDGE * np.eye(2), spread[:2, 2])
    normal = np.append(-slopes, 1)
    return mean[2] - slopes @ mean[:2], normal / np.linalg.norm(normal)


def _sphere(z, points):
    """Height at the centre and normal of the algebraic sphere u0 + u·x + uq x² whose gradient fits the normals."""
    x, n, w = _weighed(z, points)
    total = w.sum()
    if total == 0:
        return 0.0, np.zeros(3)
    square = (x**2).sum(axis=1)
    spread = w @ square - (w @ x) @ (w @ x) / total + constants.APSS_RIDGE * total
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
