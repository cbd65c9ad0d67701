"""Algebraic point set surfaces (APSS): project each point onto the surface that fits the points of its 3 × 3 pixels.

The points near in depth form surfaces; for each of the K strongest of a pixel, its point moves along the line of sight
onto a plane or sphere, fitted with weights (1 − distance² / APSS_REACH²)₊². Lengths are in pixels here: (column, row,
depth / scale). `torch.baselines.apss` has the details.
"""

import numpy as np
from numba import boolean, float32, get_num_threads, get_thread_id

from srt3d_ros.kernels.constants import (
    APSS_PROJECTIONS,
    APSS_REACH,
    APSS_RIDGE,
    APSS_SAME_SURFACE,
    APSS_SHARED,
    APSS_STILL,
    TINY,
)
from srt3d_ros.kernels.cpu.arithmetic import F32, wrap
from srt3d_ros.kernels.cpu.compiling import each, floats2d, floats3d, floats4d, inline, line
from srt3d_ros.kernels.cpu.spans import ALL
from srt3d_ros.kernels.cpu.vectors import floor, fma, full, lanes_of, sqrt, where
from srt3d_ros.kernels.maps import LANES

CENTRE_FIRST = 4, 0, 1, 2, 3, 5, 6, 7, 8        # pixels of 3 × 3, row by row
FAR = 1e6                                       # where a point is that is not there
# Rows of the scratch memory, [ROWS, 9 K, LANES]. Of a point: its depth. Of a surface: how many points it has, their
# mean depth, its intensity in the pixel itself, later its strength; points, intensity in others.
Z, COUNT, MEAN, OWN, NEIGHBOURS, OTHERS, ROWS = range(7)


@line
def _join(z, there, strength, is_own, used, scratch):
    """Join a point of each pixel to the first surface that is near, or to a new one; how many are in use."""
    c = 0
    while lanes_of(there):
        if c == used:
            for row in range(COUNT, ROWS):
                scratch[row, c, ALL] = 0
            used += 1
        count, mean = scratch[COUNT, c, ALL], scratch[MEAN, c, ALL]
        joins = there & ((count == 0) | (abs(z - mean) < APSS_SAME_SURFACE))
        scratch[COUNT, c, ALL] = where(joins, count + 1, count)
        scratch[MEAN, c, ALL] = where(joins, mean + (z - mean) / (count + 1), mean)
        total = OWN if is_own else OTHERS
        scratch[total, c, ALL] = scratch[total, c, ALL] + where(joins, strength, 0)
        if not is_own:
            scratch[NEIGHBOURS, c, ALL] = scratch[NEIGHBOURS, c, ALL] + where(joins, 1, 0)
        there &= ~joins
        c += 1
    return used


@line
def _collect(i, j, depth, intensity, scale, period, scratch):
    """Write the points of the 3 × 3 pixels, and join them to surfaces by depth, those of the pixel itself first.

    Returns the first point's depth, bins, from which depths count, and how many surfaces a pixel has at most.
    """
    layers, origin, is_first, used = depth.shape[1], full(0.0), full(True), 0
    for place in CENTRE_FIRST:
        a, b = i + place // 3 - 1, j + place % 3 - 1
        for k in range(layers):
            strength, t = intensity[a, k, b], depth[a, k, b]
            there = strength > 0
            origin, is_first = where(there & is_first, t, origin), is_first & ~there
            z = wrap(t - origin, period) / scale
            scratch[Z, place * layers + k, ALL] = where(there, z, FAR)
            used = _join(z, there, strength, place == 4, used, scratch)
    return origin, used


@line
def _weigh(used, enough, scratch):
    """Write the strengths of surfaces over their own intensities; 0 if they have too few points."""
    for c in range(used):
        others = scratch[OTHERS, c, ALL] / max(scratch[NEIGHBOURS, c, ALL], 1)
        strength = (1 - APSS_SHARED) * scratch[OWN, c, ALL] + APSS_SHARED * others
        exists = (enough > 0) & (scratch[COUNT, c, ALL] >= enough)
        scratch[OWN, c, ALL] = where(exists, strength, 0)


@line
def _take_strongest(used, scratch):
    """The strength and the mean depth of the strongest surfaces, which are taken out; 0 if there is none."""
    best, at, which = full(0.0), full(0.0), full(0.0)
    for c in range(used):
        strength = scratch[OWN, c, ALL]
        stronger = strength > best
        best, which = max(strength, best), where(stronger, c, which)
        at = where(stronger, scratch[MEAN, c, ALL], at)
    for c in range(used):
        scratch[OWN, c, ALL] = where(which == c, 0, scratch[OWN, c, ALL])
    return best, at


@inline
def _weight(x, y, z):
    """A point's weight in a fit, and its squared distance."""
    square = z * z + (x * x + y * y)
    near = max(1 - square / (APSS_REACH * APSS_REACH), 0)
    return near * near, square


@line
def _plane(at, layers, scratch):
    """The plane z = c + sx x + sy y by weighted least squares: c, and x and y of its normal."""
    w = wx = wy = wz = wxx = wyy = wxy = wxz = wyz = full(0.0)
    for p in range(9 * layers):
        x, y, z = p // layers % 3 - 1, p // layers // 3 - 1, scratch[Z, p, ALL] - at
        f, _ = _weight(x, y, z)
        f_z = f * z
        w, wx, wy, wz = w + f, fma(f, x, wx), fma(f, y, wy), wz + f_z
        wxx, wyy, wxy = fma(f, x * x, wxx), fma(f, y * y, wyy), fma(f, x * y, wxy)
        wxz, wyz = fma(f_z, x, wxz), fma(f_z, y, wyz)
    w += TINY
    mx, my, mz = wx / w, wy / w, wz / w
    cxx, cyy, cxy = wxx / w - mx * mx + APSS_RIDGE, wyy / w - my * my + APSS_RIDGE, wxy / w - mx * my
    cxz, cyz = wxz / w - mx * mz, wyz / w - my * mz
    det = cxx * cyy - cxy * cxy
    sx, sy = (cyy * cxz - cxy * cyz) / det, (cxx * cyz - cxy * cxz) / det
    length = sqrt(1 + sx * sx + sy * sy)
    return mz - sx * mx - sy * my, -sx / length, -sy / length


@line
def _sphere(i, j, at, normal, scratch):
    """The sphere c + l · p + q p² = 0 whose gradient fits the normals: how far along z it is, x and y of its normal."""
    w = wx = wy = wz = wu = wv = wn = wpp = wpn = full(0.0)
    layers = normal.shape[2]
    for p in range(9 * layers):
        right, down = p // layers % 3 - 1, p // layers // 3 - 1
        x, y, z = right, down, scratch[Z, p, ALL] - at
        u, v = normal[0, i + down, p % layers, j + right], normal[1, i + down, p % layers, j + right]
        n, (f, square) = sqrt(max(1 - u * u - v * v, 0)), _weight(x, y, z)
        w, wx, wy, wz = w + f, fma(f, x, wx), fma(f, y, wy), fma(f, z, wz)
        wu, wv, wn, wpp = fma(f, u, wu), fma(f, v, wv), fma(f, n, wn), fma(f, square, wpp)
        wpn = fma(f, u * x + v * y + n * z, wpn)
    w += TINY
    spread = wpp - (wx * wx + wy * wy + wz * wz) / w
    q = 0.5 * (wpn - (wx * wu + wy * wv + wz * wn) / w) / (spread + APSS_RIDGE * w)
    lx, ly, lz = (wu - 2 * q * wx) / w, (wv - 2 * q * wy) / w, (wn - 2 * q * wz) / w
    c = -(lx * wx + ly * wy + lz * wz + q * wpp) / w
    # The root nearer to 0 of c + lz d + q d²; lz is positive unless the normals contradict each other.
    root = sqrt(max(lz * lz - 4 * q * c, 0))
    d = -2 * c / where(lz >= 0, lz + root + TINY, lz - root - TINY)
    gz = lz + 2 * q * d
    length = sqrt(lx * lx + ly * ly + gz * gz) + TINY
    length = where(gz >= 0, length, -length)
    return d, lx / length, ly / length


@line
def _project(i, j, at, there, spheres, normal, scratch):
    """Move points along the line of sight onto the surfaces fitted around them: their depths, x and y of normals."""
    u, v, step = full(0.0), full(0.0), 0
    while step < APSS_PROJECTIONS and lanes_of(there):
        move, x, y = (_sphere(i, j, at, normal, scratch) if spheres else _plane(at, normal.shape[2], scratch))
        at, u, v = where(there, at + move, at), where(there, x, u), where(there, y, v)
        there, step = there & (abs(move) >= APSS_STILL), step + 1
    return at, u, v


@each
def _apss(i, j, depth: floats3d, intensity: floats3d, normal: floats4d, scale: float32, period: float32,
          spheres: boolean, scratch: floats4d, new_depth: floats3d, new_normal: floats4d, new_intensity: floats3d,
          enough: floats2d):
    own = scratch[get_thread_id()]
    if lanes_of(enough[i, j] > 0):
        origin, used = _collect(i, j, depth, intensity, scale, period, own)
        _weigh(used, enough[i, j], own)
        for k in range(depth.shape[1]):
            strength, at = _take_strongest(used, own)
            there = strength > 0
            at, u, v = _project(i, j, at, there, spheres, normal, own)
            t = fma(at, scale, origin)
            new_depth[i, k, j] = where(there, t - period * floor(t / period), 0)
            new_intensity[i, k, j], new_normal[0, i, k, j], new_normal[1, i, k, j] = strength, u, v


def apss(depth, intensity, normal, enough, scale, num_bins):
    known = np.zeros((2, *depth.shape), np.float32) if normal is None else normal
    after = np.zeros_like(depth), np.zeros_like(intensity), np.zeros_like(known)
    _apss(depth, intensity, known, F32(scale), F32(num_bins), normal is not None,
          np.empty((get_num_threads(), ROWS, 9 * depth.shape[1], LANES), np.float32), after[0], after[2], after[1],
          enough)
    return after
