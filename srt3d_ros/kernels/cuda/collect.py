"""The list of a frame's points. How many there are only the device knows, so it has room for all that there can be.

The lists lie one behind the other in one buffer of bytes, which takes one copy to download: 37 bytes a point.
"""

import torch
import triton
import triton.language as tl

from srt3d_ros.kernels.cuda.maps import DEPTH, FIELDS, MARGIN, SLOPE_COL, SLOPE_ROW

PIXELS = 128                    # of one program
HEAD = 16                       # bytes: the number of points, and what keeps the lists aligned
LISTS = ((torch.float32, 5), (torch.float32, 3), (torch.uint16, 1), (torch.uint16, 1), (torch.uint8, 1))
POINT = sum(dtype.itemsize * width for dtype, width in LISTS)


@triton.jit
def _count(intensity, cols, pixels, counts, SURFACES: tl.constexpr, LAYERS: tl.constexpr, PIXELS: tl.constexpr):
    pixel, k = tl.program_id(0) * PIXELS + tl.arange(0, PIXELS), tl.arange(0, LAYERS)[:, None]
    at = (pixel // cols * (SURFACES * cols) + pixel % cols)[None, :] + k * cols
    r = tl.load(intensity + at, mask=(pixel < pixels)[None, :] & (k < SURFACES), other=0.0)
    tl.store(counts + tl.program_id(0), tl.sum(tl.sum((r > 0.0).to(tl.int32), axis=0), axis=0))


@triton.jit
def _collect(state, intensity, std, rays, metres_per_bin, metres, period, counts, ends, cols, padded_cols, pixels,
             capacity, number, values, xyz, row, col, rank, SURFACES: tl.constexpr, LAYERS: tl.constexpr,
             PIXELS: tl.constexpr):
    part, k = tl.program_id(0), tl.arange(0, LAYERS)[:, None]
    pixel = part * PIXELS + tl.arange(0, PIXELS)
    inside, i, j = (pixel < pixels)[None, :] & (k < SURFACES), (pixel // cols)[None, :], (pixel % cols)[None, :]
    at = (i * SURFACES + k) * cols + j
    r = tl.load(intensity + at, mask=inside, other=0.0)
    before = tl.zeros([LAYERS, PIXELS], tl.int32)           # points of the pixel that are stronger
    for q in tl.static_range(SURFACES):
        other = tl.load(intensity + (i * SURFACES + q) * cols + j, mask=(pixel < pixels)[None, :], other=0.0)
        before += ((other > r) | ((other == r) & (q < k))).to(tl.int32)
    own, end = tl.sum((r > 0.0).to(tl.int32), axis=0), tl.load(ends + part)
    first = end - tl.load(counts + part) + tl.cumsum(own, axis=0) - own
    n, there = first[None, :] + before, r > 0.0
    if part == tl.num_programs(0) - 1:
        tl.store(number, end)

    point = state + ((i + MARGIN) * SURFACES + k) * FIELDS * padded_cols + j + MARGIN
    depth = tl.load(point + DEPTH * padded_cols, mask=there, other=0.0)
    depth = tl.where(depth < period, depth, 0.0)            # where rounding made it T
    tl.store(values + n, depth, mask=there)
    tl.store(values + capacity + n, r, mask=there)
    tl.store(values + 2 * capacity + n, tl.load(std + at, mask=there, other=0.0), mask=there)
    tl.store(values + 3 * capacity + n, tl.load(point + SLOPE_ROW * padded_cols, mask=there, other=0.0), mask=there)
    tl.store(values + 4 * capacity + n, tl.load(point + SLOPE_COL * padded_cols, mask=there, other=0.0), mask=there)
    range_m, ray = depth * metres_per_bin + metres, rays + (i * cols + j) * 3
    for c in tl.static_range(3):
        tl.store(xyz + 3 * n + c, tl.load(ray + c + k * 0, mask=there, other=0.0) * range_m, mask=there)
    tl.store(row + n, (i + k * 0).to(tl.uint16), mask=there)
    tl.store(col + n, (j + k * 0).to(tl.uint16), mask=there)
    tl.store(rank + n, before.to(tl.uint8), mask=there)


def collect(state, intensity, std, rays, metres_per_bin, metres, num_bins):
    """All lists in one tensor, uint8 [HEAD + POINT · rows · K · cols], for `unpack`; the host does not wait for it."""
    rows, surfaces, cols = intensity.shape
    pixels, capacity = rows * cols, rows * cols * surfaces
    packed = intensity.new_empty(HEAD + POINT * capacity, dtype=torch.uint8)
    counts = intensity.new_empty(triton.cdiv(pixels, PIXELS), dtype=torch.int32)
    sizes = {"SURFACES": surfaces, "LAYERS": triton.next_power_of_2(surfaces), "PIXELS": PIXELS}
    _count[(len(counts),)](intensity, cols, pixels, counts, **sizes)
    ends = torch.cumsum(counts, 0, dtype=torch.int32)
    _collect[(len(counts),)](state, intensity, std, rays, metres_per_bin, metres, float(num_bins), counts, ends, cols,
                             state.shape[3], pixels, capacity, *_split(packed), **sizes)
    return packed,


def unpack(points: tuple[torch.Tensor]) -> tuple:
    """NumPy views of the tensor of `collect`; of one in the host's memory they share it."""
    packed, = points
    number, values, xyz, row, col, rank = (part.numpy() for part in _split(packed.cpu()))
    n = int(number[0])
    return row[:n], col[:n], rank[:n], values.reshape(5, -1)[:, :n], xyz[:3 * n].reshape(n, 3)


def _split(packed: torch.Tensor) -> list[torch.Tensor]:
    """The number of points, int32 [1], and the lists, each with room for all."""
    capacity, start, parts = (len(packed) - HEAD) // POINT, HEAD, [packed[:4].view(torch.int32)]
    for dtype, width in LISTS:
        end = start + capacity * width * dtype.itemsize
        parts.append(packed[start:end].view(dtype))
        start = end
    return parts
