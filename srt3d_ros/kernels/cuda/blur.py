"""Pools: values summed over a Gaussian window of cells, rows first, then columns.

A window over cells is one over pixels, whose weights are the same all over a cell.
"""

import triton
import triton.language as tl

WIDE = 256          # numbers of a map that one program sums


@triton.jit
def _blur_rows(values, weights, rows, line, out, STEP: tl.constexpr, TAPS: tl.constexpr, WIDE: tl.constexpr):
    """Sums over rows: a row of all channels is one line of numbers."""
    i, at = tl.program_id(1), tl.program_id(0) * WIDE + tl.arange(0, WIDE)
    first = (i - TAPS // 2) * STEP
    total = tl.zeros([WIDE], tl.float32)
    for tap in tl.static_range(TAPS * STEP):
        a = first + tap
        weight = tl.load(weights + tap // STEP, mask=(a >= 0) & (a < rows), other=0.0)
        a = tl.minimum(tl.maximum(a, 0), rows - 1)
        total += weight * tl.load(values + a * line + at, mask=at < line, other=0.0)
    tl.store(out + i * line + at, total, mask=at < line)


@triton.jit
def _blur_cols(values, weights, cols, count, out_cols, out, STEP: tl.constexpr, TAPS: tl.constexpr,
               WIDE: tl.constexpr):
    """Sums over columns of `count` numbers, whatever line they are in."""
    at = tl.program_id(0) * WIDE + tl.arange(0, WIDE)
    line, first = at // out_cols, (at % out_cols - TAPS // 2) * STEP
    total = tl.zeros([WIDE], tl.float32)
    for tap in tl.static_range(TAPS * STEP):
        b = first + tap
        inside = (at < count) & (b >= 0) & (b < cols)
        total += tl.load(weights + tap // STEP) * tl.load(values + line * cols + b, mask=inside, other=0.0)
    tl.store(out + at, total, mask=at < count)


def blur(values, weights, step, out=None):
    """Two launches; each reads a number once from memory, 2 · radius + 1 times from the cache."""
    rows, channels, cols = values.shape
    out_rows, out_cols = triton.cdiv(rows, step), triton.cdiv(cols, step)
    tall = values.new_empty(out_rows, channels, cols)
    out = values.new_empty(out_rows, channels, out_cols) if out is None else out
    line, count = channels * cols, out_rows * channels * out_cols
    constants = {"STEP": step, "TAPS": len(weights), "WIDE": WIDE}
    _blur_rows[(triton.cdiv(line, WIDE), out_rows)](values, weights, rows, line, tall, **constants)
    _blur_cols[(triton.cdiv(count, WIDE),)](tall, weights, cols, count, out_cols, out, **constants)
    return out
