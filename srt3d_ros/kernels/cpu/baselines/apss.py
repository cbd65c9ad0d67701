"""Algebraic point set surfaces (APSS): project each point onto the surface that fits the points of its 3 × 3 pixels.

The points near in depth form surfaces; for each of the K strongest of a pixel, its point moves along the line of sight
onto a plane or sphere, fitted with weights (1 − distance² / APSS_REACH²)₊². Lengths are in pixels here: (column, row,
depth / scale). `torch.baselines.apss` has the details.
"""

from typing import NamedTuple

import numpy as np
from numba import boolean, float32, prange

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, ONE, TINY, TWO, ZERO
from srt3d_ros.kernels.cpu.compiling import inline, parallel
from srt3d_ros.kernels.cpu.method.field import wrap

REACH, SAME_SURFACE, STILL, SHARED, RIDGE = (F32(value) for value in (
    constants.APSS_REACH, constants.APSS_SAME_SURFACE, constants.APSS_STILL, constants.APSS_SHARED,
    constants.APSS_RIDGE))
ENOUGH, PROJECTIONS = constants.APSS_ENOUGH, constants.APSS_PROJECTIONS
CENTRE_FIRST = 4, 0, 1, 2, 3, 5, 6, 7, 8        # pixels of 3 × 3, row by row
# Rows of two tables. Of a point: its position, pixels, and its normal.
X, Y, Z, NX, NY, NZ = range(6)
# Of a surface: how many points it has, their mean depth, its intensity in the pixel itself, and its points and their
# intensity in the other pixels.
COUNT, MEAN, OWN, NEIGHBOURS, OTHERS = range(5)


class Points(NamedTuple):
    """Depths (bins) and intensities [rows, K, cols], and x and y of the normals [2, rows, K, cols]."""

    depth: float32[:, :, ::1]
    intensity: float32[:, :, ::1]
    normal: float32[:, :, :, ::1]


@inline
def _gather(i, j, cloud, scale, period, points, surfaces):
    """Collect the points of the 3 × 3 pixels, those of pixel (i, j) first, and join them to surfaces by depth.

    Returns how many points, surfaces and pixels there are, and the first point's depth, bins, from which depths count.
    """
    depth, intensity, normal = cloud
    rows, layers, cols = depth.shape
    found, clusters, pixels, origin = 0, 0, 0, ZERO
    for at in CENTRE_FIRST:
        di, dj = at // 3 - 1, at % 3 - 1
        a, b = i + di, j + dj
        if a < 0 or a >= rows or b < 0 or b >= cols:
            continue
        pixels += 1
        for k in range(layers):
            if intensity[a, k, b] <= ZERO:
                continue
            origin = depth[a, k, b] if found == 0 else origin
            z, nx, ny = wrap(depth[a, k, b] - origin, period) / scale, normal[0, a, k, b], normal[1, a, k, b]
            points[X, found], points[Y, found], points[Z, found] = F32(dj), F32(di), z
            points[NX, found], points[NY, found] = nx, ny
            points[NZ, found] = np.sqrt(max(ONE - nx * nx - ny * ny, ZERO))
            found += 1
            c = 0
            while c < clusters and abs(z - surfaces[MEAN, c]) >= SAME_SURFACE:
                c += 1
            if c == clusters:
                clusters += 1
                surfaces[:, c] = ZERO
            surfaces[COUNT, c] += ONE
            surfaces[MEAN, c] += (z - surfaces[MEAN, c]) / surfaces[COUNT, c]
            if at == 4:
                surfaces[OWN, c] += intensity[a, k, b]
            else:
                surfaces[NEIGHBOURS, c] += ONE
                surfaces[OTHERS, c] += intensity[a, k, b]
    return found, clusters, pixels, origin


@inline
def _fit(at, found, points, spheres):
    """Fit the surface through the points near depth `at`: its distance from there, and x and y of its normal.

    A plane z = c + sx x + sy y by weighted least squares; or an algebraic sphere c + l·p + q p² = 0 whose gradient
    fits the points' normals.
    """
    w, wx, wy, wz = ZERO, ZERO, ZERO, ZERO
    wxx, wyy, wxy, wxz, wyz = ZERO, ZERO, ZERO, ZERO, ZERO
    wu, wv, wn, wpp, wpn = ZERO, ZERO, ZERO, ZERO, ZERO
    for p in range(found):
        x, y, z = points[X, p], points[Y, p], points[Z, p] - at
        square = x * x + y * y + z * z
        near = max(ONE - square / (REACH * REACH), ZERO)
        f = near * near
        w += f
        wx += f * x
        wy += f * y
        wz += f * z
        if spheres:
            u, v, n = points[NX, p], points[NY, p], points[NZ, p]
            wu += f * u
            wv += f * v
            wn += f * n
            wpp += f * square
            wpn += f * (u * x + v * y + n * z)
        else:
            wxx += f * x * x
            wyy += f * y * y
            wxy += f * x * y
            wxz += f * x * z
            wyz += f * y * z
    w += TINY
    if not spheres:
        mx, my, mz = wx / w, wy / w, wz / w
        cxx, cyy, cxy = wxx / w - mx * mx + RIDGE, wyy / w - my * my + RIDGE, wxy / w - mx * my
        cxz, cyz = wxz / w - mx * mz, wyz / w - my * mz
        det = cxx * cyy - cxy * cxy
        sx, sy = (cyy * cxz - cxy * cyz) / det, (cxx * cyz - cxy * cxz) / det
        length = np.sqrt(ONE + sx * sx + sy * sy)
        return mz - sx * mx - sy * my, -sx / length, -sy / length
    spread = wpp - (wx * wx + wy * wy + wz * wz) / w
    q = HALF * (wpn - (wx * wu + wy * wv + wz * wn) / w) / (spread + RIDGE * w)
    lx, ly, lz = (wu - TWO * q * wx) / w, (wv - TWO * q * wy) / w, (wn - TWO * q * wz) / w
    c = -(lx * wx + ly * wy + lz * wz + q * wpp) / w
    # The root nearer to 0 of c + lz d + q d²; lz is positive unless the normals contradict each other.
    root = np.sqrt(max(lz * lz - F32(4) * q * c, ZERO))
    d = -TWO * c / (lz + root + TINY) if lz >= ZERO else -TWO * c / (lz - root - TINY)
    gz = lz + TWO * q * d
    length = np.sqrt(lx * lx + ly * ly + gz * gz) + TINY
    return d, (lx if gz >= ZERO else -lx) / length, (ly if gz >= ZERO else -ly) / length


@parallel
def _apss(cloud: Points, exposure: float32[:, ::1], scale: float32, period: float32, spheres: boolean, after: Points):
    new_depth, new_intensity, new_normal = after
    rows, layers, cols = cloud.depth.shape
    for i in prange(rows):
        points, surfaces = np.empty((6, 9 * layers), np.float32), np.empty((5, 9 * layers), np.float32)
        for j in range(cols):
            if exposure[i, j] <= ZERO:
                continue
            found, clusters, pixels, origin = _gather(i, j, cloud, scale, period, points, surfaces)
            strength = surfaces[OWN]
            for c in range(clusters):
                if surfaces[COUNT, c] >= F32(min(ENOUGH, pixels)):
                    strength[c] = ((ONE - SHARED) * strength[c]
                                   + SHARED * surfaces[OTHERS, c] / max(surfaces[NEIGHBOURS, c], ONE))
                else:
                    strength[c] = ZERO
            for k in range(min(layers, clusters)):
                best = 0
                for c in range(clusters):
                    best = c if strength[c] > strength[best] else best
                if strength[best] <= ZERO:
                    break
                at, move, step, gx, gy = surfaces[MEAN, best], ONE, 0, ZERO, ZERO
                while step < PROJECTIONS and abs(move) >= STILL:
                    move, gx, gy = _fit(at, found, points, spheres)
                    at += move
                    step += 1
                t = origin + at * scale
                new_depth[i, k, j] = t - period * np.floor(t / period)
                new_intensity[i, k, j] = strength[best]
                new_normal[0, i, k, j], new_normal[1, i, k, j] = gx, gy
                strength[best] = ZERO


def apss(depth, intensity, normal, exposure, scale, num_bins):
    known = np.zeros((2, *depth.shape), np.float32) if normal is None else normal
    after = Points(np.zeros_like(depth), np.zeros_like(intensity), np.zeros_like(known))
    _apss(Points(depth, intensity, known), exposure, F32(scale), F32(num_bins), normal is not None, after)
    return tuple(after)
