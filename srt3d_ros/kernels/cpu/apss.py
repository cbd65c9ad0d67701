"""Algebraic point set surfaces (APSS): smooth a point cloud, create and remove points, spread intensities.

    G. Guennebaud, M. Gross, "Algebraic point set surfaces", SIGGRAPH 2007, as the denoiser of RT3D (J. Tachella et al.,
    Nature Communications 10, 2019) and of SRT3D.

Lengths are in pixels here: (column, row, depth / scale), so that all three directions smooth alike.
"""

import numpy as np
from numba import prange

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cpu.arithmetic import F32, HALF, ONE, TINY, TWO, ZERO
from srt3d_ros.kernels.cpu.compiling import inline, parallel
from srt3d_ros.kernels.cpu.field import wrap

REACH, SAME_SURFACE, STILL, SHARED, RIDGE = (F32(value) for value in (
    constants.APSS_REACH, constants.APSS_SAME_SURFACE, constants.APSS_STILL, constants.APSS_SHARED,
    constants.APSS_RIDGE))
ENOUGH, PROJECTIONS = constants.APSS_ENOUGH, constants.APSS_PROJECTIONS


@inline
def _gather(i, j, depth, intensity, normal, scale, period, x, y, z, r, nx, ny):
    """Collect the points of the 3 × 3 neighbourhood, those of pixel (i, j) first; depths count from the first one's.

    Returns how many there are, how many are the pixel's own, what their depths count from (bins), and how many pixels.
    """
    rows, surfaces, cols = depth.shape
    found, own, pixels, origin = 0, 0, 0, ZERO
    for order in range(9):
        at = 4 if order == 0 else (order - 1 if order <= 4 else order)      # the centre, then the others
        di, dj = at // 3 - 1, at % 3 - 1
        a, b = i + di, j + dj
        if a < 0 or a >= rows or b < 0 or b >= cols:
            continue
        pixels += 1
        for k in range(surfaces):
            if intensity[a, k, b] > ZERO:
                origin = depth[a, k, b] if found == 0 else origin
                x[found], y[found] = F32(dj), F32(di)
                z[found] = wrap(depth[a, k, b] - origin, period) / scale
                r[found] = intensity[a, k, b]
                nx[found], ny[found] = normal[0, a, k, b], normal[1, a, k, b]
                found += 1
        own = found if order == 0 else own
    return found, own, origin, pixels


@inline
def _cluster(found, z, member, count, mean):
    """Join points whose depths agree into surfaces; returns how many surfaces there are."""
    surfaces, least, most, total = 0, ZERO, ZERO, ZERO
    for p in range(found):
        least, most, total = min(least, z[p]), max(most, z[p]), total + z[p]
        member[p] = 0
    if most - least < SAME_SURFACE:                 # all are one surface, as nearly everywhere
        count[0], mean[0] = found, total / F32(max(found, 1))
        return min(found, 1)
    for p in range(found):
        joined = -1
        for c in range(surfaces):
            if joined < 0 and abs(z[p] - mean[c]) < SAME_SURFACE:
                joined = c
        if joined < 0:
            joined = surfaces
            surfaces += 1
            count[joined], mean[joined] = 0, ZERO
        count[joined] += 1
        mean[joined] += (z[p] - mean[joined]) / F32(count[joined])
        member[p] = joined
    return surfaces


@inline
def _shared_intensity(c, found, own, member, r):
    """Intensity of surface c in the pixel: 0.9 of its own and 0.1 of its neighbours' mean; without own, that 0.1."""
    mine, others, neighbours = ZERO, ZERO, 0
    for p in range(found):
        if member[p] == c:
            if p < own:
                mine += r[p]
            else:
                others += r[p]
                neighbours += 1
    return (ONE - SHARED) * mine + (SHARED * others / F32(neighbours) if neighbours > 0 else ZERO)


@inline
def _plane(at, found, x, y, z):
    """Weighted least-squares plane z = c + sx x + sy y near depth `at`: how far it is from there, and normal."""
    w, wx, wy, wz, wxx, wyy, wxy, wxz, wyz = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
    for p in range(found):
        e = z[p] - at
        near = max(ONE - (x[p] * x[p] + y[p] * y[p] + e * e) / (REACH * REACH), ZERO)
        f = near * near
        w += f
        wx += f * x[p]
        wy += f * y[p]
        wz += f * e
        wxx += f * x[p] * x[p]
        wyy += f * y[p] * y[p]
        wxy += f * x[p] * y[p]
        wxz += f * x[p] * e
        wyz += f * y[p] * e
    w += TINY
    mx, my, mz = wx / w, wy / w, wz / w
    cxx, cyy, cxy = wxx / w - mx * mx + RIDGE, wyy / w - my * my + RIDGE, wxy / w - mx * my
    cxz, cyz = wxz / w - mx * mz, wyz / w - my * mz
    det = cxx * cyy - cxy * cxy
    sx, sy = (cyy * cxz - cxy * cyz) / det, (cxx * cyz - cxy * cxz) / det
    length = np.sqrt(ONE + sx * sx + sy * sy)
    return mz - sx * mx - sy * my, -sx / length, -sy / length


@inline
def _sphere(at, found, x, y, z, nx, ny):
    """Algebraic sphere c + l·p + q p² = 0 through oriented points near depth `at`: how far it is, and normal."""
    w, wx, wy, wz, wu, wv, wn, wpp, wpn = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
    for p in range(found):
        e = z[p] - at
        square = x[p] * x[p] + y[p] * y[p] + e * e
        near = max(ONE - square / (REACH * REACH), ZERO)
        f = near * near
        nz = np.sqrt(max(ONE - nx[p] * nx[p] - ny[p] * ny[p], ZERO))
        w += f
        wx += f * x[p]
        wy += f * y[p]
        wz += f * e
        wu += f * nx[p]
        wv += f * ny[p]
        wn += f * nz
        wpp += f * square
        wpn += f * (nx[p] * x[p] + ny[p] * y[p] + nz * e)
    w += TINY
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
def _apss(depth, intensity, normal, exposure, scale, period, spheres, new_depth, new_intensity, new_normal):
    rows, surfaces, cols = depth.shape
    most = 9 * surfaces
    for i in prange(rows):
        x, y, z, r, nx, ny, mean = (np.empty(most, np.float32), np.empty(most, np.float32), np.empty(most, np.float32),
                                    np.empty(most, np.float32), np.empty(most, np.float32), np.empty(most, np.float32),
                                    np.empty(most, np.float32))
        member, count, strength = np.empty(most, np.int64), np.empty(most, np.int64), np.empty(most, np.float32)
        for j in range(cols):
            for k in range(surfaces):
                new_intensity[i, k, j] = ZERO
            if exposure[i, j] <= ZERO:
                continue
            found, own, origin, pixels = _gather(i, j, depth, intensity, normal, scale, period, x, y, z, r, nx, ny)
            clusters = _cluster(found, z, member, count, mean)
            for c in range(clusters):
                supported = count[c] >= min(ENOUGH, pixels)
                strength[c] = _shared_intensity(c, found, own, member, r) if supported else ZERO
            for k in range(surfaces):
                best = -1
                for c in range(clusters):
                    if strength[c] > ZERO and (best < 0 or strength[c] > strength[best]):
                        best = c
                if best < 0:
                    break
                at, move, step, gx, gy = mean[best], ONE, 0, ZERO, ZERO
                while step < PROJECTIONS and abs(move) >= STILL:
                    if spheres:
                        move, gx, gy = _sphere(at, found, x, y, z, nx, ny)
                    else:
                        move, gx, gy = _plane(at, found, x, y, z)
                    at += move
                    step += 1
                t = origin + at * scale
                new_depth[i, k, j] = t - period * np.floor(t / period)
                new_intensity[i, k, j] = strength[best]
                new_normal[0, i, k, j], new_normal[1, i, k, j] = gx, gy
                strength[best] = ZERO


def apss(depth, intensity, normal, exposure, scale, num_bins):
    """A pass of the point cloud's denoiser.

    Points of 3 × 3 pixels whose depths lie within APSS_SAME_SURFACE of their mean make a surface, if they are
    APSS_ENOUGH, or as many as there are pixels. For each of the K strongest the pixel's point moves along its line of
    sight onto the surface that is fitted with weights (1 − distance² / APSS_REACH²)₊²: a plane by least squares without
    normals, else a sphere u₀ + u · x + u_q |x|² = 0 whose gradient fits them; up to APSS_PROJECTIONS times, until it
    moves by less than APSS_STILL. Intensity is 1 − APSS_SHARED times the pixel's own, and APSS_SHARED times its
    neighbours' mean, so that surfaces grow into pixels without a point.

    Args:
        depth, intensity: float32 [rows, K, cols], bins and photons.
        normal: float32 [2, rows, K, cols], x and y of unit normals with z > 0; None in the first pass.
        exposure: float32 [rows, cols]; pixels with 0 get no point.
        scale: bins that count as one pixel.
        num_bins: T.

    Returns:
        Depth, intensity and normal, the strongest point of a pixel first.
    """
    known = np.zeros((2, *depth.shape), np.float32) if normal is None else normal
    out = np.zeros_like(depth), np.empty_like(intensity), np.zeros_like(known)
    _apss(depth, intensity, known, exposure, F32(scale), F32(num_bins), normal is not None, *out)
    return out
