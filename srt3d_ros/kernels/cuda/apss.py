"""Algebraic point set surfaces (APSS): smooth a point cloud, create and remove points, spread intensities.

The papers and the choices are named in kernels/cpu/apss.py. Lengths are in pixels here: (column, row, depth / scale).
A program works on BLOCK pixels of a row; the points of their neighbourhoods are a tensor [POINTS, BLOCK] of one warp,
those of the pixel itself first. Per pixel 72 bytes are read from the caches and 16 written, and some 4,000 operations
done for each surface, most of them in the sums of up to 5 projections.
"""

import torch
import triton
import triton.language as tl

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cuda.arithmetic import TINY, wrap

REACH, SAME_SURFACE, ENOUGH, PROJECTIONS, STILL, SHARED, RIDGE = (tl.constexpr(value) for value in (
    constants.APSS_REACH, constants.APSS_SAME_SURFACE, constants.APSS_ENOUGH, constants.APSS_PROJECTIONS,
    constants.APSS_STILL, constants.APSS_SHARED, constants.APSS_RIDGE))
PER_THREAD = 16             # points that each thread of a program's warp holds in registers


@triton.jit
def _plane(at, there, x, y, z):
    """Weighted least-squares plane z = c + sx x + sy y near depth `at`: how far it is from there, and normal."""
    e = z - at[None, :]
    f = tl.maximum(1.0 - (x * x + y * y + e * e) / (REACH * REACH), 0.0)
    f = tl.where(there, f * f, 0.0)
    w = tl.sum(f, axis=0) + TINY
    mx, my, mz = tl.sum(f * x, axis=0) / w, tl.sum(f * y, axis=0) / w, tl.sum(f * e, axis=0) / w
    cxx, cyy = tl.sum(f * x * x, axis=0) / w - mx * mx + RIDGE, tl.sum(f * y * y, axis=0) / w - my * my + RIDGE
    cxy = tl.sum(f * x * y, axis=0) / w - mx * my
    cxz, cyz = tl.sum(f * x * e, axis=0) / w - mx * mz, tl.sum(f * y * e, axis=0) / w - my * mz
    det = cxx * cyy - cxy * cxy
    sx, sy = (cyy * cxz - cxy * cyz) / det, (cxx * cyz - cxy * cxz) / det
    length = tl.sqrt(1.0 + sx * sx + sy * sy)
    return mz - sx * mx - sy * my, -sx / length, -sy / length


@triton.jit
def _sphere(at, there, x, y, z, nx, ny):
    """Algebraic sphere c + l·p + q p² = 0 through oriented points near depth `at`: how far it is, and normal."""
    e = z - at[None, :]
    square = x * x + y * y + e * e
    f = tl.maximum(1.0 - square / (REACH * REACH), 0.0)
    f = tl.where(there, f * f, 0.0)
    nz = tl.sqrt(tl.maximum(1.0 - nx * nx - ny * ny, 0.0))
    w = tl.sum(f, axis=0) + TINY
    wx, wy, wz = tl.sum(f * x, axis=0), tl.sum(f * y, axis=0), tl.sum(f * e, axis=0)
    wu, wv, wn = tl.sum(f * nx, axis=0), tl.sum(f * ny, axis=0), tl.sum(f * nz, axis=0)
    wpp, wpn = tl.sum(f * square, axis=0), tl.sum(f * (nx * x + ny * y + nz * e), axis=0)
    spread = wpp - (wx * wx + wy * wy + wz * wz) / w
    q = 0.5 * (wpn - (wx * wu + wy * wv + wz * wn) / w) / (spread + w * RIDGE)
    lx, ly, lz = (wu - 2.0 * q * wx) / w, (wv - 2.0 * q * wy) / w, (wn - 2.0 * q * wz) / w
    c = -(lx * wx + ly * wy + lz * wz + q * wpp) / w
    # The root nearer to 0 of c + lz d + q d²; lz is positive unless the normals contradict each other.
    root = tl.sqrt(tl.maximum(lz * lz - 4.0 * q * c, 0.0))
    d = -2.0 * c / tl.where(lz >= 0.0, lz + root + TINY, lz - root - TINY)
    gz = lz + 2.0 * q * d
    length = (tl.sqrt(lx * lx + ly * ly + gz * gz) + TINY) * tl.where(gz >= 0.0, 1.0, -1.0)
    return d, lx / length, ly / length


@triton.jit
def _apss(depth, intensity, normal, exposure, scale, period, new_depth, new_intensity, new_normal, rows, cols,
          SPHERES: tl.constexpr, SURFACES: tl.constexpr, POINTS: tl.constexpr, BLOCK: tl.constexpr):
    i, j = tl.program_id(1), tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    inside = j < cols
    used = tl.load(exposure + i * cols + j, mask=inside, other=0.0) > 0.0

    # The points of the 3 × 3 neighbourhood, those of the pixel first; depths count from the first one's.
    p = tl.arange(0, POINTS)[:, None]
    order = p // SURFACES
    n = tl.where(order == 0, 4, tl.where(order <= 4, order - 1, order))
    x, y = n % 3 - 1, n // 3 - 1
    a, b = i + y, j[None, :] + x
    there = (order < 9) & (a >= 0) & (a < rows) & (b >= 0) & (b < cols)
    pixels = tl.sum((there & (p % SURFACES == 0)).to(tl.int32), axis=0)
    place = (a * SURFACES + p % SURFACES) * cols + b
    r = tl.load(intensity + place, mask=there, other=0.0)
    there = r > 0.0
    t = tl.load(depth + place, mask=there, other=0.0)
    first = tl.min(tl.where(there, p, POINTS), axis=0)
    origin = tl.sum(tl.where(p == first[None, :], t, 0.0), axis=0)
    z = wrap(t - origin[None, :], period) / scale
    x, y = x.to(tl.float32), y.to(tl.float32)
    if SPHERES:
        nx = tl.load(normal + place, mask=there, other=0.0)
        ny = tl.load(normal + rows * SURFACES * cols + place, mask=there, other=0.0)

    # Points whose depths agree are one surface: of surfaces p how many points it has, their mean, whose they are.
    mean, mine, others = tl.zeros_like(z), tl.zeros_like(z), tl.zeros_like(z)
    count, neighbours, surfaces = tl.zeros_like(z), tl.zeros_like(z), tl.zeros_like(first)
    for c in range(9 * SURFACES):
        is_c = p == c
        found = tl.sum((is_c & there).to(tl.int32), axis=0) > 0
        z_c, r_c = tl.sum(tl.where(is_c, z, 0.0), axis=0), tl.sum(tl.where(is_c, r, 0.0), axis=0)
        near = (p < surfaces[None, :]) & (tl.abs(z_c[None, :] - mean) < SAME_SURFACE)
        joined = tl.minimum(tl.min(tl.where(near, p, POINTS), axis=0), surfaces)
        joins = (p == joined[None, :]) & found[None, :]
        count = tl.where(joins, count + 1.0, count)
        mean = tl.where(joins, mean + (z_c[None, :] - mean) / tl.maximum(count, 1.0), mean)
        if c < SURFACES:
            mine = tl.where(joins, mine + r_c[None, :], mine)
        else:
            others = tl.where(joins, others + r_c[None, :], others)
            neighbours = tl.where(joins, neighbours + 1.0, neighbours)
        surfaces = tl.where(found & (joined == surfaces), surfaces + 1, surfaces)

    # Of its own intensity 0.9, of its neighbours' mean 0.1; fewer than 4 points make no surface.
    strength = mine * (1.0 - SHARED) + others * SHARED / tl.maximum(neighbours, 1.0)
    strength = tl.where(used[None, :] & (count >= tl.minimum(pixels, ENOUGH)[None, :]), strength, 0.0)
    for k in tl.static_range(SURFACES):
        strongest = tl.max(strength, axis=0)
        best = tl.min(tl.where(strength == strongest[None, :], p, POINTS), axis=0)
        shown = strongest > 0.0
        at = tl.sum(tl.where(p == best[None, :], mean, 0.0), axis=0)
        gx, gy, moving = tl.zeros_like(at), tl.zeros_like(at), shown
        for _ in range(PROJECTIONS):
            if tl.max(moving.to(tl.int32), axis=0) > 0:
                if SPHERES:
                    move, to_x, to_y = _sphere(at, there, x, y, z, nx, ny)
                else:
                    move, to_x, to_y = _plane(at, there, x, y, z)
                at = tl.where(moving, at + move, at)
                gx, gy = tl.where(moving, to_x, gx), tl.where(moving, to_y, gy)
                moving = moving & (tl.abs(move) >= STILL)
        out = (i * SURFACES + k) * cols + j
        at = origin + at * scale
        tl.store(new_depth + out, tl.where(shown, at - period * tl.floor(at / period), 0.0), mask=inside)
        tl.store(new_intensity + out, strongest, mask=inside)
        tl.store(new_normal + out, gx, mask=inside)
        tl.store(new_normal + rows * SURFACES * cols + out, gy, mask=inside)
        strength = tl.where(p == best[None, :], 0.0, strength)


def apss(depth, intensity, normal, exposure, scale, num_bins):
    rows, surfaces, cols = depth.shape
    out = torch.empty_like(depth), torch.empty_like(depth), depth.new_empty(2, rows, surfaces, cols)
    points = triton.next_power_of_2(9 * surfaces)
    block = 32 * PER_THREAD // points
    _apss[triton.cdiv(cols, block), rows](
        depth, intensity, depth if normal is None else normal, exposure, float(scale), float(num_bins), *out, rows,
        cols, SPHERES=normal is not None, SURFACES=surfaces, POINTS=points, BLOCK=block, num_warps=1)
    return out
