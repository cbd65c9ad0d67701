"""The Gauss-Newton step of every point on its pool: `pooled_step`.

In a block, images are [K, rows, cols], and what depends on a neighbour's surface too is [N, K, K', rows, cols].
"""

from functools import partial

import torch

from srt3d_ros.kernels.constants import CELL, RIDGE, TINY
from srt3d_ros.kernels.maps import CURVATURE, DEPTH, INTENSITY, MARGIN, RESIDUAL, SCORE, SLOPE_COL, SLOPE_ROW, STD
from srt3d_ros.kernels.oracle.arithmetic import agreement, wrap
from srt3d_ros.kernels.oracle.likelihood import evidence
from srt3d_ros.kernels.oracle.windows import by_rows, images, inner, neighbours, square, window

PAIRS = 20              # numbers that a block holds for each pair of a point and a neighbour's surface, about


def pooled_step(frame, state, terms, sigma, radius, fine, max_chi2):
    """Gauss-Newton step of every point on Σ_q w_q f_q, the data terms of the window moved along its tangent plane.

    w = exp(−distance² / 2σ²) · (1 − e² / max_chi2 (std² + std_q²))₊² is the weight of a surface q at distance e
    (bins) from the point's plane. Over the round window, distance² ≤ radius (radius + 1),

        V = Σ w (v − s e − b e² / 2),  S = Σ w (s + b e),  B = Σ w b,  N = Σ w² n,  p = Σ w n,  G = Σ w g.

    Neighbours within the square of `fine` pixels count one by one. Farther ones, if radius > fine, count in cells of
    CELL × CELL pixels at multiples of CELL: the same sums over the cell (N with w²), with w = the agreement alone,
    along the plane of the cell's middle point.

    The plane is fitted to the depths of pixels, and of the cells' middle points, by least squares: weights
    w / std_q², of cells CELL² as much, and the ridge C / (E Σ w / std_q²) + RIDGE on the slopes. Its turn (Δ_col,
    Δ_row) moves S by −Δ · Σ w b · offset. The step is d = S / max(B, V₊ C / 2E), at most δ, and
    R = V + d S − d² B / 2.

    With S' = min(R₊ / E, p) the point gets intensity R₊ / (E G), standard deviation
    √((S' M₁ + (p − S') M₀) N / p) / (S' C), at most T, score p / √N · ρ(R₊ / p), and residual
    √(Σ w b e² / B − (std_before² − std²)₊)₊: how far the surface leaves the plane, by about which the
    depth may be wrong, less noise that the step takes away.

    Args:
        sigma, radius: of the window, pixels; radius at most MARGIN.
        fine: pixels; 1 + 3 i, so that cells begin where it ends.
        max_chi2: as of `birth_death`.
    """
    out = torch.zeros_like(state)
    near, far, cells = window(radius, -1, fine, 1, state.dtype, state.device), None, terms
    if radius // CELL * CELL > fine:            # else no cell's centre is in the window
        far = window(radius, fine, MARGIN, CELL, state.dtype, state.device)
        around, cells = square(CELL // 2, state.dtype, state.device), torch.zeros_like(terms)
        pooled = partial(_coarsen, around, frame.num_bins, max_chi2)
        inner(cells)[:] = by_rows(pooled, _row_bytes(state, around), state, terms)[0]
    step = partial(_step, frame, near, far, sigma, max_chi2)
    inner(out)[:] = by_rows(step, _row_bytes(state, near), state, terms, cells)[0]
    return out


def _row_bytes(state, window) -> int:
    return PAIRS * len(window.row) * state.shape[1]**2 * state[0, 0, 0].nbytes


def _coarsen(around, period, max_chi2, state, terms):
    """Rows of the terms of the 3 × 3 pixels around each point, pooled along its plane."""
    own = images(inner(state))
    weight, e, _ = _weigh(own, state, around, max_chi2, period)
    pooled = torch.stack(_pool(weight, e, neighbours(terms, around)), 1)
    return ((pooled * (own[:, INTENSITY, None] > 0)).movedim(-2, 0),)


def _step(frame, near, far, sigma, max_chi2, state, terms, cells):
    """The rows of the next state."""
    own, pooled, plane = images(inner(state)), 0, 0
    for around, values, pixels in ((near, terms, 1), (far, cells, CELL**2))[:1 if far is None else 2]:
        dy, dx = around.dy[:, None, None], around.dx[:, None, None]
        weight, e, variance = _weigh(own, state, around, max_chi2, frame.num_bins)
        weight = weight * torch.exp(-(dy**2 + dx**2) / (2 * sigma**2))
        shown = neighbours(values, around)
        bend = weight * shown[:, None, :, CURVATURE]
        sums = [_over(bend * by) for by in (e**2, dx, dy)]
        pooled = pooled + torch.stack([*_pool(weight, e, shown), *sums])
        plane = plane + _moments(pixels * weight / variance, e, dy, dx)
    off_plane, bend_col, bend_row = pooled[6:]
    turn_col, turn_row = _fit(plane, own[:, SLOPE_COL], own[:, SLOPE_ROW], frame.curvature / frame.total_energy)
    pooled[1] -= turn_col * bend_col + turn_row * bend_row
    after = _stepped(frame, own, pooled[:6], off_plane)
    after[:, SLOPE_COL], after[:, SLOPE_ROW] = own[:, SLOPE_COL] + turn_col, own[:, SLOPE_ROW] + turn_row
    return (after.where(own[:, INTENSITY, None] > 0, 0).movedim(-2, 0),)


def _over(values):
    """Sums over the neighbours' surfaces."""
    return values.sum((0, 2))


def _weigh(own, state, around, max_chi2, period):
    """Weights of neighbours' surfaces by how far they lie on each point's plane, distances from it, and variances."""
    depth, std, intensity = (neighbours(state[:, :, field], around)[:, None] for field in (DEPTH, STD, INTENSITY))
    plane = own[:, DEPTH] + own[:, SLOPE_COL] * around.dx[:, None] + own[:, SLOPE_ROW] * around.dy[:, None]
    e = wrap(depth - plane[:, :, None], period)
    close = agreement(e, max_chi2 * (own[:, None, STD]**2 + std**2) + TINY)
    return close**2 * (intensity > 0), e, std**2 + TINY


def _pool(weight, e, shown) -> list:
    """Sums of weighted terms, each moved from its surface's depth to the plane, e bins away, in the order of `maps`."""
    v, s, b, n, p, g = shown[:, None].unbind(3)
    return [_over(weight * (v - e * (s + e * b / 2))), _over(weight * (s + b * e)), _over(weight * b),
            _over(weight**2 * n), _over(weight * p), _over(weight * g)]


def _moments(f, e, dy, dx):
    """Of the planes: Σ f, and the means by f of dx, dy, dx², dy², dx dy, e, e dx and e dy."""
    one = torch.ones_like(dx)
    return torch.stack([_over(f * by) for by in (one, dx, dy, dx**2, dy**2, dx * dy, e, e * dx, e * dy)])


def _fit(sums, slope_col, slope_row, steepness):
    """By how much the planes turn to the least-squares fit; a slope is held to 0 as by one more measurement."""
    total = sums[0] + TINY
    x, y, xx, yy, xy, rise, x_rise, y_rise = sums[1:] / total
    ridge = steepness / total + RIDGE
    x_rise, y_rise = x_rise - x * rise - ridge * slope_col, y_rise - y * rise - ridge * slope_row
    xx, yy, xy = xx - x * x + ridge, yy - y * y + ridge, xy - x * y
    det = xx * yy - xy * xy
    return (yy * x_rise - xy * y_rise) / det, (xx * y_rise - xy * x_rise) / det


def _stepped(frame, own, pooled, off_plane):
    """The points after a Newton step on their pooled data terms, measured there; with the slopes of before."""
    total, period = frame.total_energy, frame.num_bins
    value, gradient, curvature, squares, photons, exposure = pooled
    least = value.clamp(min=0) / total * frame.curvature / 2
    bend = torch.maximum(curvature, least) + TINY
    d = (gradient / bend).clamp(-frame.resolution_bins, frame.resolution_bins)
    value = value + d * (gradient - d * curvature / 2)
    strength = value.clamp(min=0) / total
    signal = torch.minimum(strength, photons)
    variance = signal * frame.moments[0] + (photons - signal) * frame.moments[1]
    std = (variance * squares / photons.clamp(min=TINY)).sqrt() / (signal * frame.curvature).clamp(min=TINY)
    after = own.clone()
    after[:, DEPTH] = (own[:, DEPTH] + d) % period
    after[:, INTENSITY] = (strength / exposure.clamp(min=TINY)).clamp(min=TINY)
    after[:, STD] = std.clamp(max=period).where(signal > 0, period)
    after[:, SCORE] = evidence(value, photons, squares, frame)
    gone = (own[:, STD]**2 - after[:, STD]**2).clamp(min=0)
    after[:, RESIDUAL] = (off_plane / bend - gone).clamp(min=0).sqrt()
    return after
