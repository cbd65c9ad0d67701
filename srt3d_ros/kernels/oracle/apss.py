"""Algebraic point set surfaces (APSS): smooth a point cloud, create and remove points, spread intensities.

    G. Guennebaud, M. Gross, "Algebraic point set surfaces", SIGGRAPH 2007, as the denoiser of RT3D (J. Tachella et al.,
    Nature Communications 10, 2019) and of SRT3D.

The points of a pixel's neighbourhood are the second axis of tensors [rows, points, cols].
"""

import torch

from srt3d_ros.kernels.constants import (
    APSS_ENOUGH,
    APSS_PROJECTIONS,
    APSS_REACH,
    APSS_RIDGE,
    APSS_SAME_SURFACE,
    APSS_SHARED,
    APSS_STILL,
)
from srt3d_ros.kernels.oracle.arithmetic import TINY, wrap

PLACES = [(0, 0), (-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)]     # rows and columns away


def apss(depth, intensity, normal, exposure, scale, num_bins):
    """A pass of the point cloud's denoiser, algebraic point set surfaces (Guennebaud and Gross, 2007).

    Lengths are in pixels, (column, row, t / scale). Points of 3 × 3 pixels whose depths lie within
    APSS_SAME_SURFACE of their mean make a surface, if they are APSS_ENOUGH, or as many as there are pixels. For
    each of the K strongest the pixel's point moves along its line of sight onto the surface that is fitted with
    weights (1 − distance² / APSS_REACH²)₊²: a plane by least squares without normals, else a sphere
    u₀ + u · x + u_q |x|² = 0 whose gradient fits them; up to APSS_PROJECTIONS times, until it moves by less than
    APSS_STILL. Intensity is 1 − APSS_SHARED times the pixel's own, and APSS_SHARED times its neighbours' mean, so
    that surfaces grow into pixels without a point.

    Args:
        depth, intensity: float32 [rows, K, cols], bins and photons.
        normal: float32 [2, rows, K, cols], x and y of unit normals with z > 0; None in the first pass.
        exposure: float32 [rows, cols]; pixels with 0 get no point.
        scale: bins that count as one pixel.
        num_bins: T.

    Returns:
        Depth, intensity and normal, the strongest point of a pixel first.
    """
    surfaces, most = depth.shape[1], len(PLACES) * depth.shape[1]
    r, t, pixels = (_around(values) for values in (intensity, depth, torch.ones_like(depth[:, :1])))
    there, numbers = r > 0, torch.arange(most, device=depth.device)[:, None]
    origin = t.gather(1, there.long().argmax(dim=1, keepdim=True))              # depths count from the first point's
    y, x = (torch.tensor([place[axis] for place in PLACES for _ in range(surfaces)], dtype=t.dtype,
                         device=t.device)[:, None] for axis in (0, 1))
    points = x, y, wrap(t - origin, num_bins) / scale
    normals = None if normal is None else [_around(values) for values in normal]

    # Points whose depths agree are one surface.
    mean, count, mine, others, neighbours = (torch.zeros_like(t) for _ in range(5))
    for p in range(most):
        z = points[2][:, p:p + 1]
        close = (count > 0) & ((z - mean).abs() < APSS_SAME_SURFACE)
        first = torch.where(close.any(dim=1), close.long().argmax(dim=1), (count > 0).sum(dim=1))
        joins = (numbers == first[:, None]) & there[:, p:p + 1]
        count += joins
        mean += joins * (z - mean) / count.clamp(min=1)
        if p < surfaces:
            mine += joins * r[:, p:p + 1]
        else:
            others += joins * r[:, p:p + 1]
            neighbours += joins

    enough = (count >= pixels.sum(dim=1, keepdim=True).clamp(max=APSS_ENOUGH)) & (exposure > 0)[:, None]
    strength = ((1 - APSS_SHARED) * mine + APSS_SHARED * others / neighbours.clamp(min=1)) * enough
    found = []
    for _ in range(surfaces):
        shared, best = strength.max(dim=1, keepdim=True)
        at, moving = mean.gather(1, best)[:, 0], (shared > 0)[:, 0]
        facing = torch.zeros_like(at), torch.zeros_like(at)
        for _ in range(APSS_PROJECTIONS):
            move, *to = _plane(at, there, *points) if normal is None else _sphere(at, there, *points, *normals)
            at = torch.where(moving, at + move, at)
            facing = [torch.where(moving, new, old) for new, old in zip(to, facing)]
            moving &= move.abs() >= APSS_STILL
        found.append((torch.where(shared[:, 0] > 0, (origin[:, 0] + at * scale) % num_bins, 0), shared[:, 0], *facing))
        strength = strength.scatter(1, best, 0)
    depth, intensity, *facing = (torch.stack(values, dim=1) for values in zip(*found))
    return depth, intensity, torch.stack(facing)


def _around(values):
    """The values [rows, K, cols] of each pixel's 3 × 3 neighbourhood, its own first, [rows, 9K, cols]; 0 outside."""
    rows, _, cols = values.shape
    wide = torch.nn.functional.pad(values, (1, 1, 0, 0, 1, 1))
    return torch.cat([wide[1 + i:1 + i + rows, :, 1 + j:1 + j + cols] for i, j in PLACES], dim=1)


def _weights(at, there, x, y, z):
    """Positions along the line of sight from a depth on, squared distances, and weights (1 − d² / h²)²₊."""
    e = z - at[:, None]
    square = x * x + y * y + e * e
    return e, square, (1 - square / APSS_REACH**2).clamp(min=0)**2 * there


def _plane(at, there, x, y, z):
    """Weighted least-squares plane z = c + sx x + sy y near depth `at`: how far it is from there, and normal."""
    e, _, f = _weights(at, there, x, y, z)
    w = f.sum(dim=1) + TINY
    mx, my, mz, xx, yy, xy, xz, yz = ((f * v).sum(dim=1) / w for v in (x, y, e, x * x, y * y, x * y, x * e, y * e))
    cxx, cyy, cxy, cxz, cyz = xx - mx * mx + APSS_RIDGE, yy - my * my + APSS_RIDGE, xy - mx * my, xz - mx * mz, \
        yz - my * mz
    det = cxx * cyy - cxy * cxy
    sx, sy = (cyy * cxz - cxy * cyz) / det, (cxx * cyz - cxy * cxz) / det
    length = torch.sqrt(1 + sx * sx + sy * sy)
    return mz - sx * mx - sy * my, -sx / length, -sy / length


def _sphere(at, there, x, y, z, nx, ny):
    """Algebraic sphere c + l·p + q p² = 0 through oriented points near depth `at`: how far it is, and normal."""
    e, square, f = _weights(at, there, x, y, z)
    nz = (1 - nx * nx - ny * ny).clamp(min=0).sqrt()
    w = f.sum(dim=1) + TINY
    mx, my, mz, u, v, n, mpp, mpn = ((f * value).sum(dim=1) / w for value in (
        x, y, e, nx, ny, nz, square, nx * x + ny * y + nz * e))
    spread = mpp - (mx * mx + my * my + mz * mz) + APSS_RIDGE
    q = (mpn - (mx * u + my * v + mz * n)) / spread / 2
    lx, ly, lz = u - 2 * q * mx, v - 2 * q * my, n - 2 * q * mz
    c = -(lx * mx + ly * my + lz * mz + q * mpp)
    # The root nearer to 0 of c + lz d + q d²; lz is positive unless the normals contradict each other.
    root = (lz * lz - 4 * q * c).clamp(min=0).sqrt()
    d = -2 * c / torch.where(lz >= 0, lz + root + TINY, lz - root - TINY)
    gz = lz + 2 * q * d
    length = (torch.sqrt(lx * lx + ly * ly + gz * gz) + TINY) * torch.where(gz >= 0, 1, -1)
    return d, lx / length, ly / length
