"""Algebraic point set surfaces (APSS): smooth a point cloud, create and remove points, spread intensities.

    G. Guennebaud, M. Gross, "Algebraic point set surfaces", SIGGRAPH 2007, as the denoiser of RT3D (J. Tachella et al.,
    Nature Communications 10, 2019) and of SRT3D.

Lengths are in pixels here: (column, row, depth / scale), so that all three directions smooth alike. The first axis are
the points of 3 × 3 pixels, P = 9 K, or the surfaces that they form, of which there may be as many.
"""

import torch

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.constants import TINY
from srt3d_ros.kernels.torch.arithmetic import wrap
from srt3d_ros.kernels.torch.fusing import fused

CENTRE_FIRST = 4, 0, 1, 2, 3, 5, 6, 7, 8        # pixels of 3 × 3, row by row


def apss(depth, intensity, normal, enough, scale, num_bins):
    """A pass of the point cloud's denoiser.

    Points of 3 × 3 pixels whose depths lie within APSS_SAME_SURFACE of their mean make a surface, if they are `enough`.
    For each of the K strongest the pixel's point moves along its line of sight onto the surface that is fitted with
    weights (1 − distance² / APSS_REACH²)₊²: a plane by least squares without normals, else a sphere u₀ + u · x +
    u_q |x|² = 0 whose gradient fits them; up to APSS_PROJECTIONS times, until it moves by less than APSS_STILL.
    Intensity is 1 − APSS_SHARED times the pixel's own, and APSS_SHARED times its neighbours' mean, so that surfaces
    grow into pixels without a point.
    """
    origin, strength, onto = _joined(depth, intensity, enough, scale, num_bins)
    for _ in range(constants.APSS_PROJECTIONS):
        onto = _projected(onto, depth, intensity, normal, origin, scale, num_bins)
    return _moved(onto, origin, strength, scale, num_bins)


@fused
def _joined(depth, intensity, enough, scale, num_bins) -> tuple:
    """Join the points to surfaces: the depth they count from [rows, cols], strengths [K, rows, cols], and `onto`.

    `onto` is [4, K, rows, cols]: depth, x and y of the normal, and whether the last move was above APSS_STILL (1 or 0).
    """
    points, layers = _around(intensity), depth.shape[1]
    there, at = points > 0, torch.arange(len(points), device=depth.device)[:, None, None]
    place, k = at // layers, at % layers
    rank = layers * torch.where(place == 4, 0, place + (place < 4)) + k
    first = torch.where(there, rank, len(points)).amin(dim=0)
    origin = (_around(depth) * (rank == first)).sum(dim=0)
    mean, strength = _surfaces(wrap(_around(depth) - origin, num_bins) / scale, points, there, at, layers, enough)
    found = []
    for _ in range(layers):
        best = strength.amax(dim=0)
        which = torch.where(strength == best, at, len(points)).amin(dim=0)
        found.append((best, (mean * (at == which)).sum(dim=0)))
        strength = strength.masked_fill(at == which, 0)
    best, depths = (torch.stack(values) for values in zip(*found))
    return origin, best, torch.stack([depths, 0 * depths, 0 * depths, 0 * depths + 1])     # constants: a launch each


@fused
def _moved(onto, origin, strength, scale, num_bins) -> tuple:
    """Depth, intensity and normal as `apss` returns them."""
    shown = strength > 0
    depth, intensity, *normal = (torch.where(shown, values, 0).movedim(0, 1) for values in (
        (origin + onto[0] * scale) % num_bins, strength, *onto[1:3]))
    return depth.contiguous(), intensity.contiguous(), torch.stack(normal)


def _around(values):
    """The values [rows, K, cols] of the points of 3 × 3 pixels, row by row, 0 outside: [P, rows, cols]."""
    rows, _, cols = values.shape
    padded = torch.nn.functional.pad(values, (1, 1, 0, 0, 1, 1))
    return padded.unfold(0, rows, 1).unfold(2, cols, 1).movedim(1, 2).flatten(0, 2)      # [dy, dx, K, rows, cols]


def _surfaces(z, intensity, there, surface, layers, enough):
    """Join each point to the first surface whose mean depth is near, or to a new one: their means and strengths.

    A surface has the rank of its first point; `surface` are the ranks, [P, 1, 1].
    """
    of, count, total = [], torch.zeros_like(z), torch.zeros_like(z)
    points = [place * layers + k for place in CENTRE_FIRST for k in range(layers)]
    for p, point in enumerate(points):
        apart = (z[point] - total / count.clamp(min=1)).abs()
        near = (count > 0) & (apart < constants.APSS_SAME_SURFACE) | (surface == p)
        of.append(torch.where(there[point], torch.where(near, surface, len(points)).amin(dim=0), -1))
        joins = surface == of[-1]
        count, total = count + joins, total + joins * z[point]
    own, others = (sum((surface == of[p]) * intensity[points[p]] for p in range(*ends))
                   for ends in ((0, layers), (layers, len(points))))
    neighbours = sum((surface == other).to(z.dtype) for other in of[layers:])
    strength = (1 - constants.APSS_SHARED) * own + constants.APSS_SHARED * others / neighbours.clamp(min=1)
    return total / count.clamp(min=1), strength.masked_fill((count < enough) | (enough == 0), 0)


@fused
def _projected(onto, depth, intensity, normal, origin, scale, num_bins):
    """Move `onto` along the lines of sight to the surfaces that are fitted around its depths."""
    at, *slopes, moves = onto
    place, there = torch.arange(9, device=at.device).repeat_interleave(depth.shape[1]), _around(intensity) > 0
    x, y = ((side - 1).to(at.dtype)[:, None, None, None] for side in (place % 3, place // 3))
    z = (wrap(_around(depth) - origin, num_bins) / scale)[:, None] - at
    if normal is None:
        move, *new = _plane(x, y, z, there[:, None])
    else:
        move, *new = _sphere(x, y, z, there[:, None], *(_around(side)[:, None] for side in normal))
    going = moves > 0
    slopes = [torch.where(going, *both) for both in zip(new, slopes)]
    return torch.stack([at + move * moves, *slopes, moves * (move.abs() >= constants.APSS_STILL)])


def _weights(x, y, z, there):
    """Each point's weight in a fit, and its squared distance."""
    square = x * x + y * y + z * z
    return (1 - square / constants.APSS_REACH**2).clamp(min=0)**2 * there, square


def _plane(x, y, z, there):
    """The plane z = c + sx x + sy y by weighted least squares: c, and x and y of its normal."""
    f, _ = _weights(x, y, z, there)
    w = f.sum(dim=0) + TINY
    mx, my, mz, mxx, myy, mxy, mxz, myz = ((f * values).sum(dim=0) / w for values in (
        x, y, z, x * x, y * y, x * y, x * z, y * z))
    cxx, cyy, cxy = mxx - mx * mx + constants.APSS_RIDGE, myy - my * my + constants.APSS_RIDGE, mxy - mx * my
    cxz, cyz = mxz - mx * mz, myz - my * mz
    det = cxx * cyy - cxy * cxy
    sx, sy = (cyy * cxz - cxy * cyz) / det, (cxx * cyz - cxy * cxz) / det
    length = (1 + sx * sx + sy * sy).sqrt()
    return mz - sx * mx - sy * my, -sx / length, -sy / length


def _sphere(x, y, z, there, u, v):
    """The sphere c + l · p + q p² = 0 whose gradient fits the normals: how far along z it is, x and y of its normal."""
    f, square = _weights(x, y, z, there)
    n = (1 - u * u - v * v).clamp(min=0).sqrt()
    w, wx, wy, wz, wu, wv, wn, wpp, wpn = ((f * values).sum(dim=0) for values in (
        torch.ones_like(z), x, y, z, u, v, n, square, u * x + v * y + n * z))
    w = w + TINY
    spread = wpp - (wx * wx + wy * wy + wz * wz) / w
    q = 0.5 * (wpn - (wx * wu + wy * wv + wz * wn) / w) / (spread + constants.APSS_RIDGE * w)
    lx, ly, lz = (wu - 2 * q * wx) / w, (wv - 2 * q * wy) / w, (wn - 2 * q * wz) / w
    c = -(lx * wx + ly * wy + lz * wz + q * wpp) / w
    # The root nearer to 0 of c + lz d + q d²; lz is positive unless the normals contradict each other.
    root = (lz * lz - 4 * q * c).clamp(min=0).sqrt()
    d = -2 * c / torch.where(lz >= 0, lz + root + TINY, lz - root - TINY)
    gz = lz + 2 * q * d
    length = (lx * lx + ly * ly + gz * gz).sqrt() + TINY
    length = torch.where(gz >= 0, length, -length)
    return d, lx / length, ly / length
