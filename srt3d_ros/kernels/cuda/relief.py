"""How far surfaces leave the tangent planes along which their points pool photons."""

import triton
import triton.language as tl

from srt3d_ros.core import layout
from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cuda.arithmetic import LOG2E, TINY, wrap
from srt3d_ros.kernels.cuda.layout import BLOCK, DEPTH, FIELDS, INTENSITY, MARGIN, SLOPE_COL, SLOPE_ROW, STD

STEP = tl.constexpr(constants.STEP)


@triton.jit
def _relief(state, fall, gate, astray, period, out, wide: tl.constexpr, RADIUS: tl.constexpr, WIDTH: tl.constexpr,
            SURFACES: tl.constexpr):
    """A line of the neighbourhood at once, WIDTH pixels or fewer."""
    i, j = tl.program_id(1) + MARGIN, tl.program_id(0) * BLOCK + MARGIN + tl.arange(0, BLOCK)
    points = state + i * SURFACES * FIELDS * wide + j
    mine = points + tl.program_id(2) * FIELDS * wide
    t, std = tl.load(mine + DEPTH * wide), tl.load(mine + STD * wide)
    sc, sr = tl.load(mine + SLOPE_COL * wide), tl.load(mine + SLOPE_ROW * wide)
    dx = (tl.arange(0, WIDTH) * STEP - RADIUS)[:, None]
    weight, square = tl.zeros([WIDTH, BLOCK], tl.float32), tl.zeros([WIDTH, BLOCK], tl.float32)
    for dy in range(-RADIUS, RADIUS + 1, STEP):
        away2 = dx * dx + dy * dy
        near = tl.where((dx <= RADIUS) & (away2 > 0), tl.exp2(fall * away2), 0.0)
        for q in tl.static_range(SURFACES):
            there = points[None, :] + ((dy * SURFACES + q) * FIELDS * wide + tl.minimum(dx, RADIUS))
            e = wrap(tl.load(there + DEPTH * wide) - (t + sr * dy)[None, :] - sc[None, :] * dx, period)
            theirs = tl.load(there + STD * wide)
            close = tl.maximum(1.0 - e * e / (gate * (theirs * theirs + (std * std)[None, :]) + TINY), 0.0)
            lit = (tl.load(there + INTENSITY * wide) > 0.0) & (theirs < astray)
            w = tl.where(lit, near * close * close, 0.0)
            weight += w
            square += w * e * e
    rms = tl.sqrt(tl.sum(square, axis=0) / (tl.sum(weight, axis=0) + TINY))
    seen = tl.load(mine + INTENSITY * wide) > 0.0
    tl.store(out + (i * SURFACES + tl.program_id(2)) * wide + j, tl.where(seen, rms, 0.0))


def relief(state, window, radius, gate, num_bins, out=None):
    """Root mean square distance of the neighbours' depths from each point's tangent plane, bins.

    A pool along a plane gives the depth of the plane: where the surface bends or is rough, it is wrong by about this.

    Args:
        state: float32 [rows', K, FIELDS, cols'].
        window: σ of the neighbours' weights, pixels.
        radius: of the neighbourhood, pixels, even, at most MARGIN.
        gate: as in `descend`.
        num_bins: T.
        out: where the result goes; its margins are left as they are.

    Returns:
        float32 [rows', K, cols'], 0 where there is no point.
    """
    tall, surfaces, _, wide = state.shape
    out = state.new_zeros(tall, surfaces, wide) if out is None else out
    _relief[((wide - 2 * layout.MARGIN) // layout.BLOCK, tall - 2 * layout.MARGIN, surfaces)](
        state, -0.5 * LOG2E.value / window**2, gate, layout.ASTRAY * num_bins, float(num_bins), out, wide=wide,
        RADIUS=radius, WIDTH=triton.next_power_of_2(2 * radius // constants.STEP + 1), SURFACES=surfaces, num_warps=1)
    return out
