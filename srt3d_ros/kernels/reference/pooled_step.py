"""The Gauss-Newton step of every point on its pool, point by point: `pooled_step`."""

import numpy as np

from srt3d_ros.kernels import maps
from srt3d_ros.kernels.constants import CELL, FINE, RIDGE
from srt3d_ros.kernels.maps import CURVATURE, DEPTH, GRADIENT, INTENSITY, SCORE, SLOPE_COL, SLOPE_ROW, STD, TERMS, VALUE
from srt3d_ros.kernels.reference.arithmetic import TINY, agreement, near, plane_depth, wrap
from srt3d_ros.kernels.reference.arrays import in_numpy

SLOPES = [SLOPE_COL, SLOPE_ROW]


@in_numpy
def pooled_step(frame, state, terms, sigma, radius, max_chi2, scratch=None, out=None):
    """Gauss-Newton step of every point on Σ_q w_q f_q, the data terms of the window moved along its tangent plane.

    w = exp(−distance² / 2σ²) · (1 − e² / max_chi2 (std² + std_q²))₊² is the weight of a surface q at distance e
    (bins) from the point's plane. Over the round window, distance² ≤ radius (radius + 1),

        V = Σ w (v − s e − b e² / 2),  S = Σ w (s + b e),  B = Σ w b,  N = Σ w² n,  p = Σ w n,  G = Σ w g.

    Neighbours within the square of FINE pixels count one by one. Farther ones, if radius > FINE, count in cells of
    CELL × CELL pixels at multiples of CELL: the same sums over the cell (N with w²), with w = the agreement alone,
    along the plane of the cell's middle point.

    The plane is fitted to the depths of pixels, and of the cells' middle points, by least squares: weights
    w / std_q², of cells CELL² as much, and the ridge C / (E Σ w / std_q²) + RIDGE on the slopes. Its turn (Δ_col,
    Δ_row) moves S by −Δ · Σ w b · offset. The step is d = S / max(B, V₊ C / 2E), at most δ, and
    R = V + d S − d² B / 2.

    With S' = min(R₊ / E, p) the point gets intensity R₊ / (E G), standard deviation
    √((S' M₁ + (p − S') M₀) N / p) / (S' C), at most T, score R / √(N E / 2), and residual
    √(Σ w b e² / B − (std_before² − std²)₊)₊: how far the surface leaves the plane, by about which the
    depth may be wrong, less noise that the step takes away.

    Args:
        sigma, radius: of the window, pixels; radius at most MARGIN.
        max_chi2: as of `birth_death`.
        out: where the next state, which is returned, goes: not to `state`. Its margins are left as they are.
    """
    after = np.zeros(state.shape)
    cells = coarsen(state, terms, frame.num_bins, max_chi2) if radius > FINE else terms
    dy, dx = _window(radius)
    fine = np.maximum(abs(dy), abs(dx)) <= FINE
    for i, k, j in np.argwhere(state[:, :, INTENSITY] > 0):
        point, around = state[i, k, :, j], state[i + dy, :, :, j + dx]
        weight, e = _weigh(point, around, dy, dx, max_chi2, frame.num_bins)
        weight *= near(dy, dx, sigma)[:, None]
        shown = np.where(fine[:, None, None], terms[i + dy, :, :, j + dx], cells[i + dy, :, :, j + dx])
        pooled = _pool(weight, e, shown)
        slopes = _plane(point, around, np.where(fine, 1, CELL**2)[:, None] * weight, e, dy, dx, frame)
        turned = slopes - point[SLOPES]
        bend = (weight * shown[..., CURVATURE]).sum(axis=1)
        pooled[GRADIENT] -= turned @ [bend @ dx, bend @ dy]
        after[i, k, :, j] = _stepped(point, slopes, pooled, (weight * shown[..., CURVATURE] * e**2).sum(), frame)
    if out is None:
        return after
    out[:] = after
    return out


def coarsen(state, terms, period, max_chi2):
    """The terms of the 3 × 3 pixels around each point, pooled along its plane; as `terms`."""
    half = CELL // 2
    dy, dx = (d.ravel() for d in np.mgrid[-half:half + 1, -half:half + 1])
    cells = np.zeros_like(terms)
    for i, k, j in np.argwhere(state[:, :, INTENSITY] > 0):
        weight, e = _weigh(state[i, k, :, j], state[i + dy, :, :, j + dx], dy, dx, max_chi2, period)
        cells[i, k, :, j] = _pool(weight, e, terms[i + dy, :, :, j + dx])
    return cells


def _window(radius) -> tuple[np.ndarray, np.ndarray]:
    """Offsets of the neighbours that a point pools: all up to FINE pixels, then the centres of cells."""
    dy, dx = (d.ravel() for d in np.mgrid[-radius:radius + 1, -radius:radius + 1])
    inside = dx**2 + dy**2 <= radius * (radius + 1)
    pooled = inside & ((np.maximum(abs(dy), abs(dx)) <= FINE) | ((dx % CELL == 0) & (dy % CELL == 0)))
    return dy[pooled], dx[pooled]


def _weigh(point, around, dy, dx, max_chi2, period) -> tuple[np.ndarray, np.ndarray]:
    """Weights of neighbours' surfaces [N, K] by how far they lie on the point's plane, and their distances from it."""
    e = wrap(around[..., DEPTH] - plane_depth(point, dy, dx)[:, None], period)
    close = agreement(e, max_chi2 * (point[STD]**2 + around[..., STD]**2))
    return np.where(around[..., INTENSITY] > 0, close**2, 0), e


def _pool(weight, e, shown) -> np.ndarray:
    """The sum [TERMS] of weighted terms, each moved from its surface's depth to the plane, e bins away."""
    value, gradient, curvature = (shown[..., term] for term in (VALUE, GRADIENT, CURVATURE))
    pooled = np.zeros(TERMS)
    pooled[VALUE] = (weight * (value - e * gradient - e**2 * curvature / 2)).sum()
    pooled[GRADIENT] = (weight * (gradient + e * curvature)).sum()
    pooled[maps.SQUARES] = (weight**2 * shown[..., maps.SQUARES]).sum()
    for term in (CURVATURE, maps.COUNTS, maps.EXPOSURE):
        pooled[term] = (weight * shown[..., term]).sum()
    return pooled


def _plane(point, around, weight, e, dy, dx, frame) -> np.ndarray:
    """Slopes of the least-squares plane through the surfaces of a window, each weighed by its variance."""
    f = weight / (around[..., STD]**2 + TINY)
    dy, dx = (np.broadcast_to(d[:, None], f.shape) for d in (dy, dx))
    total = f.sum() + TINY
    rise = e + point[SLOPE_COL] * dx + point[SLOPE_ROW] * dy
    x, y, rise = (d - (f * d).sum() / total for d in (dx, dy, rise))
    spread = np.array([[(f * a * b).sum() for a in (x, y)] for b in (x, y)]) / total
    spread += np.eye(2) * (frame.curvature / frame.total_energy / total + RIDGE)
    return np.linalg.solve(spread, [(f * x * rise).sum() / total, (f * y * rise).sum() / total])


def _stepped(point, slopes, pooled, off_plane, frame) -> np.ndarray:
    """The point after a Newton step on its pooled data term, measured there; off_plane is Σ w b e²."""
    total = frame.total_energy
    value, gradient, curvature, squares, photons, exposure = pooled
    least = max(value, 0) / total * frame.curvature / 2
    bend = max(curvature, least) + TINY
    d = np.clip(gradient / bend, -frame.resolution_bins, frame.resolution_bins)
    value += d * (gradient - d * curvature / 2)

    strength = max(value, 0) / total
    signal = min(strength, photons)
    variance = signal * frame.moments[0] + (photons - signal) * frame.moments[1]
    std = np.sqrt(variance * squares / max(photons, TINY)) / max(signal * frame.curvature, TINY)
    score = value / np.sqrt(squares * total / 2 + TINY)
    after = point.copy()
    after[DEPTH], after[SLOPES] = (point[DEPTH] + d) % frame.num_bins, slopes
    after[INTENSITY] = max(strength / max(exposure, TINY), TINY)
    after[STD] = min(std, frame.num_bins) if signal > 0 else frame.num_bins
    gone = max(point[STD]**2 - after[STD]**2, 0)
    after[SCORE], after[maps.RESIDUAL] = score, np.sqrt(max(off_plane / bend - gone, 0))
    return after
