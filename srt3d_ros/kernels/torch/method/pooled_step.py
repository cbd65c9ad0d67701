"""The Gauss-Newton step of every point on its pool: `pooled_step`.

Images are [K, rows, cols]; what depends on a neighbour's surface too is [N, K, K', rows, cols].
"""

import torch

from srt3d_ros.kernels.constants import CELL, RIDGE, TINY
from srt3d_ros.kernels.maps import CURVATURE, DEPTH, INTENSITY, SLOPE_COL, SLOPE_ROW, STD
from srt3d_ros.kernels.torch.arithmetic import agreement, wrap
from srt3d_ros.kernels.torch.fusing import fused
from srt3d_ros.kernels.torch.method.likelihood import evidence
from srt3d_ros.kernels.torch.method.windows import images, neighbours, offsets, pad_images


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
    √((S' M₁ + (p − S') M₀) N / p) / (S' C), at most T, score p / √N · ρ(R₊ / p), and

        residual = √(std² x̄ᵀ X⁻¹ x̄ + q (1 + q / (q + std²)) + M₂ N / (p S' C²) + M₃),
        q = (Q − (std_before² − std²)₊)₊.

    The first part is the noise of the slopes. The depth is measured at x̄ = Σ w b · offset / max(B, V₊ C / 2E), away
    from the point at edges; X is the covariance of the offsets in the fit, with the ridge. q is how far the surface
    leaves the plane: Q is the mean square distance of the fitted depths from the new plane, of which their own noise
    makes std_before² − std². In the middle of a bowl the error² is twice that. Neighbours farther off than the weights
    allow are not in Q: `finalise` adds the relief that they have. Where S' = 0 nothing is known: T and 0.
    Of pixels without a point only intensity and score, both 0, mean anything.
    """
    if radius // CELL * CELL <= fine:           # no cell's centre is in the window
        return _step(frame, state, ((terms, min(radius, fine), -1, 1),), sigma, radius, max_chi2)
    cells = _coarsen(frame, state, terms, max_chi2)
    return _step(frame, state, ((terms, fine, -1, 1), (cells, radius, fine, CELL)), sigma, radius, max_chi2)


@fused
def _coarsen(frame, state, terms, max_chi2):
    """The terms of the 3 × 3 pixels around each point, pooled along its plane."""
    own, reach = images(frame, state), CELL // 2
    weight, e, _ = _weigh(frame, own, state, max_chi2, reach, 1)
    pooled = torch.stack(_pool(weight, e, neighbours(frame, terms, reach)), 1)
    return pad_images(pooled * (own[:, INTENSITY, None] > 0))


@fused
def _step(frame, state, parts, sigma, radius, max_chi2):
    """The next state. Each of `parts` has terms of neighbours: up to, beyond, and in steps of how many pixels."""
    own, pooled, plane = images(frame, state), 0, 0
    for terms, reach, beyond, step in parts:
        dy, dx = (d[:, None, None] for d in offsets(reach, state, step))
        there = (torch.maximum(dy.abs(), dx.abs()) > beyond) & (dy**2 + dx**2 <= radius * (radius + 1))
        weight, e, variance = _weigh(frame, own, state, max_chi2, reach, step)
        weight = weight * (torch.exp(-(dy**2 + dx**2) / (2 * sigma**2)) * there)
        shown = neighbours(frame, terms, reach, step)
        bend = weight * shown[:, None, :, CURVATURE]
        sums = [_over(bend * by) for by in (dx, dy)]
        pooled = pooled + torch.stack([*_pool(weight, e, shown), *sums])
        plane = plane + _moments(step**2 * weight / variance, e, dy, dx)
    (value, gradient, curvature), (bend_col, bend_row) = pooled[:3], pooled[6:]
    steepness = frame.curvature / frame.total_energy
    bend = torch.maximum(curvature, value.clamp(min=0) / 2 * steepness) + TINY
    turn_col, turn_row, *fit = _fit(plane, own[:, SLOPE_COL], own[:, SLOPE_ROW], steepness, bend_col / bend,
                                    bend_row / bend)
    turned = gradient - turn_col * bend_col - turn_row * bend_row
    slopes = own[:, SLOPE_COL] + turn_col, own[:, SLOPE_ROW] + turn_row
    after = _stepped(frame, own, (value, turned, *pooled[2:6]), bend, slopes, fit)
    return pad_images(after.where(own[:, INTENSITY, None] > 0, 0))


def _over(values):
    """Sums over the neighbours' surfaces."""
    return values.sum((0, 2))


def _weigh(frame, own, state, max_chi2, reach, step):
    """Weights of neighbours' surfaces by how well they agree with each point's plane, distances e, and variances."""
    dy, dx = (d[:, None] for d in offsets(reach, state, step))
    depth, std, intensity = (neighbours(frame, state[:, :, field], reach, step)[:, None] for field in (
        DEPTH, STD, INTENSITY))
    plane = own[:, DEPTH] + own[:, SLOPE_COL] * dx + own[:, SLOPE_ROW] * dy
    e = wrap(depth - plane[:, :, None], frame.num_bins)
    close = agreement(e, max_chi2 * (own[:, None, STD]**2 + std**2) + TINY)
    return close**2 * (intensity > 0), e, std**2 + TINY


def _pool(weight, e, shown) -> list:
    """Sums of weighted terms, each moved from its surface's depth to the plane, e bins away, in the order of `maps`."""
    v, s, b, n, p, g = shown[:, None].unbind(3)
    return [_over(weight * (v - e * (s + e * b / 2))), _over(weight * (s + b * e)), _over(weight * b),
            _over(weight**2 * n), _over(weight * p), _over(weight * g)]


def _moments(f, e, dy, dx):
    """Sums of f times 1, dx, dy, dx², dy², dx dy, e, e dx, e dy and e², to which planes are fitted."""
    one = torch.ones_like(dx)
    return torch.stack([_over(f * by) for by in (one, dx, dy, dx**2, dy**2, dx * dy, e, e * dx, e * dy, e**2)])


def _fit(sums, slope_col, slope_row, steepness, col, row):
    """The turn of planes to the least-squares fit, their leverage at (col, row), mean and variance of residuals."""
    total = sums[0] + TINY
    x, y, xx, yy, xy, rise, x_rise, y_rise, rise2 = sums[1:] / total
    ridge = steepness / total + RIDGE
    x_rise, y_rise = x_rise - x * rise - ridge * slope_col, y_rise - y * rise - ridge * slope_row
    xx, yy, xy = xx - x * x + ridge, yy - y * y + ridge, xy - x * y
    det = xx * yy - xy * xy
    turn_col, turn_row = (yy * x_rise - xy * y_rise) / det, (xx * y_rise - xy * x_rise) / det
    leverage = (yy * col * col - 2 * xy * col * row + xx * row * row) / det
    spread = rise2 - rise * rise - turn_col * x_rise - turn_row * y_rise
    return turn_col, turn_row, leverage.clamp(min=0), rise - turn_col * x - turn_row * y, spread.clamp(min=0)


def _stepped(frame, own, pooled, bend, slopes, fit):
    """The points after a Newton step on their pooled data terms, measured there."""
    total, period = frame.total_energy, frame.num_bins
    (value, gradient, curvature, squares, photons, exposure), (leverage, off, spread) = pooled, fit
    d = (gradient / bend).clamp(-frame.resolution_bins, frame.resolution_bins)
    value = value + d * (gradient - d * curvature / 2)
    strength = value.clamp(min=0) / total
    signal = torch.minimum(strength, photons)
    variance = signal * frame.moments[0] + (photons - signal) * frame.moments[1]
    std = (variance * squares / photons.clamp(min=TINY)).sqrt() / (signal * frame.curvature).clamp(min=TINY)
    std = std.clamp(max=period).where(signal > 0, period)
    relief = (spread + (off - d)**2 - (own[:, STD]**2 - std**2).clamp(min=0)).clamp(min=0)
    bowl = relief**2 / (relief + std**2 + TINY)
    bins = frame.moments[2] * squares / (photons * signal * frame.curvature**2).clamp(min=TINY) + frame.moments[3]
    residual = (std**2 * leverage + relief + bowl + bins).sqrt().where(signal > 0, 0)
    return torch.stack([
        (own[:, DEPTH] + d) % period, *slopes, (strength / exposure.clamp(min=TINY)).clamp(min=TINY), std,
        evidence(value, photons, squares, frame), residual], 1)
