"""What the kernels of the baselines compute, in plain float64 NumPy, one pixel at a time: written to be read."""

import numpy as np


def wrap(difference, period):
    return difference - period * np.rint(difference / period)


# ---- Gradient steps on sketches

def pixelwise(data, table, rate, usual, depth, intensity):
    """New depth and intensity."""
    omega, energy = 2 * np.pi * data.cycles.astype(float), data.energy.astype(float)
    m, levels = len(omega), len(table)
    after_depth, after_intensity = depth.astype(float), intensity.astype(float)
    for i, k, j in np.argwhere(intensity > 0):
        g = float(data.exposure[i, j])
        z = data.matched[i, :m, j].astype(float) + 1j * data.matched[i, m:, j]
        points = zip(depth[i, :, j].astype(float), intensity[i, :, j].astype(float))
        expected = sum(g * r * energy * np.exp(1j * omega * t) for t, r in points)
        t, r = float(depth[i, k, j]), float(intensity[i, k, j])
        d = (z - expected) * np.exp(-1j * omega * t)
        share = min(g * r / max(data.noise[i, j], 1), 1)
        weights = table[int(share * (levels - 1) + 0.5)].astype(float)
        shift = weights[0] @ d.real + weights[1] @ d.imag
        change = weights[2] @ d.real + weights[3] @ d.imag
        grown = r + change / 2 / g
        signal = g * max(r, grown)
        step = rate * shift * signal / max(signal, usual * g)**2
        after_depth[i, k, j] = (t + np.clip(step, -data.resolution_bins, data.resolution_bins)) % data.num_bins
        after_intensity[i, k, j] = max(grown, 0)
    return after_depth, after_intensity


# ---- Gradient steps on times of arrival

def irf_at(place, irf, slope, num_bins):
    """h and h′ between entries, which lie on a circle of T bins."""
    entries = np.zeros((2, num_bins))
    entries[:, :len(irf)] = irf, slope
    low = int(np.floor(place))
    part = place - low
    return (1 - part) * entries[:, low % num_bins] + part * entries[:, (low + 1) % num_bins]


def poisson(data, background, rate, usual, depth, intensity):
    """New depth and intensity, and background photons."""
    after_depth, after_intensity = depth.astype(float), intensity.astype(float)
    stray = np.zeros(background.shape)
    rows, surfaces, cols = depth.shape
    for i, j in np.argwhere(data.exposure > 0):
        p, g = i * cols + j, float(data.exposure[i, j])
        own = p if len(data.irf) > 1 else 0
        signal, score = np.zeros(surfaces), np.zeros(surfaces)
        for x in data.toa[data.starts[p]:data.starts[p + 1]].astype(float):
            lit = np.array([irf_at(x - t + data.ref, data.irf[own], data.slope[own], data.num_bins) if r > 0 else (0, 0)
                            for t, r in zip(depth[i, :, j].astype(float), intensity[i, :, j])])
            r = intensity[i, :, j].astype(float)
            total = background[i, j] + r @ lit[:, 0]
            stray[i, j] += background[i, j] / total
            signal += r * lit[:, 0] / total
            score -= r * lit[:, 1] / total
        for k in np.flatnonzero(intensity[i, :, j] > 0):
            reach = 1 / np.sqrt(data.information)
            step = rate * score[k] / (max(signal[k], usual * g) * data.information)
            after_depth[i, k, j] = (depth[i, k, j] + np.clip(step, -reach, reach)) % data.num_bins
            expected = g * float(intensity[i, k, j])
            change = (signal[k] - expected) / 2 / max(expected, usual * g)
            after_intensity[i, k, j] *= np.exp(min(change, 1))
    return after_depth, after_intensity, stray


# ---- APSS

def apss(depth, intensity, normal, exposure, scale, num_bins):
    """New depth, intensity and normal."""
    rows, surfaces, cols = depth.shape
    out = np.zeros(depth.shape), np.zeros(depth.shape), np.zeros((2, *depth.shape))
    for i, j in np.argwhere(exposure > 0):
        points, pixels = _neighbourhood(i, j, depth, intensity, normal, scale, num_bins)
        found = []
        for cluster in _clusters(points):
            if len(cluster) >= min(4, pixels):
                mine, others = ([p["r"] for p in cluster if p["own"] == own] for own in (True, False))
                shared = 0.9 * sum(mine) + 0.1 * (np.mean(others) if others else 0)
                found.append((shared, np.mean([p["at"][2] for p in cluster])))
        for k, (shared, z) in enumerate(sorted(found, key=lambda f: -f[0])[:surfaces]):
            for _ in range(5):
                move, facing = (_plane if normal is None else _sphere)(z, points)
                z += move
                if abs(move) < 0.1:
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
    """Points within 4 of the mean of those that joined before."""
    clusters = []
    for p in points:
        near = (c for c in clusters if abs(p["at"][2] - np.mean([q["at"][2] for q in c])) < 4)
        home = next(near, None)
        if home is None:
            clusters.append([p])
        else:
            home.append(p)
    return clusters


def _weighed(z, points):
    """Positions from (0, 0, z), normals, and weights (1 − d² / 4)²."""
    x = np.array([p["at"] for p in points]) - [0, 0, z]
    return x, np.array([p["n"] for p in points]), np.maximum(1 - (x**2).sum(axis=1) / 4, 0)**2


def _plane(z, points):
    """Height at the centre and normal of the least-squares plane, its slopes held by a ridge of 1e-3 pixels²."""
    x, _, w = _weighed(z, points)
    if not w.any():
        return 0.0, np.zeros(3)
    mean = w @ x / w.sum()
    spread = (w[:, None] * (x - mean)).T @ (x - mean) / w.sum()
    slopes = np.linalg.solve(spread[:2, :2] + 1e-3 * np.eye(2), spread[:2, 2])
    normal = np.append(-slopes, 1)
    return mean[2] - slopes @ mean[:2], normal / np.linalg.norm(normal)


def _sphere(z, points):
    """Height at the centre and normal of the algebraic sphere u0 + u·x + uq x² whose gradient fits the normals."""
    x, n, w = _weighed(z, points)
    total = w.sum()
    if total == 0:
        return 0.0, np.zeros(3)
    square = (x**2).sum(axis=1)
    spread = w @ square - (w @ x) @ (w @ x) / total + 1e-3 * total
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
