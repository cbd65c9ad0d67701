"""What the CUDA kernels share: sine and cosine without branches, differences on a circle.

Constants that kernels read are `tl.constexpr`: Triton takes no other globals. They stand to the right of a tensor: with
them to its left, Triton 3.7 cannot interpret the product.
"""

import math

import triton
import triton.language as tl

TINY = tl.constexpr(1e-12)

# As in kernels/cpu/arithmetic.py: sin(2πx) / x and cos(2πx) as polynomials in x² on |x| ≤ 1/2, largest error 7e-7. The
# hardware's own sin.approx is no faster here: it runs at an eighth of the rate of these multiply-adds.
S0, S1, S2, S3, S4, S5, S6 = (tl.constexpr(c) for c in (
    6.28318548, -41.3417015, 81.6051331, -76.7030029, 42.0258522, -14.8995781, 3.23778009))
C1, C2, C3, C4, C5, C6, C7 = (tl.constexpr(c) for c in (
    -19.7392082, 64.9393921, -85.4566574, 60.2421265, -26.4046307, 7.80002213, -1.45298743))


@triton.jit
def sincos(turns):
    """sin and cos of 2π · turns, float32."""
    x = turns - tl.floor(turns + 0.5)
    y = x * x
    s = y * S6 + S5
    s = s * y + S4
    s = s * y + S3
    s = s * y + S2
    s = s * y + S1
    s = s * y + S0
    c = y * C7 + C6
    c = c * y + C5
    c = c * y + C4
    c = c * y + C3
    c = c * y + C2
    c = c * y + C1
    c = c * y + 1.0
    return s * x, c


@triton.jit
def wrap(difference, period):
    """The difference of two depths on a circle, in [−period/2, period/2]."""
    return difference - period * tl.floor(difference * (1.0 / period) + 0.5)


@triton.jit
def agreement(difference, variance):
    """How far depths are one surface's, 0 … 1; `variance`, above 0, is the sum of what each may be off, squared."""
    return tl.maximum(1.0 - difference * difference / variance, 0.0)


@triton.jit
def near(distance2, fall):
    """Gaussian weight by squared distance; `fall` of `fall_of`: exp2 is one instruction."""
    return tl.exp2(distance2 * fall)


def fall_of(sigma: float) -> float:
    """The factor of a squared distance with which exp(−distance² / 2σ²) is a power of 2."""
    return -0.5 / (math.log(2) * sigma**2)


def axis(m: int) -> int:
    """M, the length of a kernel's axis of m frequencies: Triton's axes are powers of two."""
    return max(triton.next_power_of_2(m), 8)
