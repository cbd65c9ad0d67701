"""What the CPU kernels share: constants, elementary functions, and how depths compare."""

import numpy as np

from srt3d_ros.kernels import constants
from srt3d_ros.kernels.cpu.compiling import inline
from srt3d_ros.kernels.cpu.vectors import bits_of, fma, rint, to_floats, to_ints

F32 = np.float32
HALF, ONE, ZERO = F32(0.5), F32(1), F32(0)       # for numbers beside numbers; vectors take any
TINY, EPSILON = F32(constants.TINY), F32(constants.EPSILON)

# sin(2πx) / x and cos(2πx) as polynomials in x² on |x| ≤ 1/2, largest error 7e-7 (Chebyshev interpolation). They run in
# vector registers; calls of libm do not.
_SIN = tuple(F32(c) for c in (6.28318548, -41.3417015, 81.6051331, -76.7030029, 42.0258522, -14.8995781, 3.23778009))
_COS = tuple(F32(c) for c in (1.0, -19.7392082, 64.9393921, -85.4566574, 60.2421265, -26.4046307, 7.80002213,
                             -1.45298743))
# log(1 + f) = f − f²/2 + f³ P(f) for √½ ≤ 1 + f < √2, largest error 3.5e-7
_LOG = tuple(F32(c) for c in (0.333337009, -0.24992542, 0.199401334, -0.169733047, 0.159031585, -0.107437))
LN_2, ROOT_HALF, MANTISSA = F32(0.693147181), np.int32(0x3F3504F3), np.int32(23)    # the bits of √½; of a fraction
# 2^f = Σ cₙ fⁿ for |f| ≤ 1/2, largest error 1.5e-7
_EXP = tuple(F32(np.log(2)**n / k) for n, k in enumerate((1, 1, 2, 6, 24, 120, 720)))
LOWEST, BIAS = F32(-126), F32(127)          # exponent of the smallest number with full precision; what bits add to it


@inline
def polynomial(x, coefficients):
    """Σ_n coefficients[n] xⁿ."""
    value = fma(x, coefficients[-1], coefficients[-2])
    for n in range(len(coefficients) - 3, -1, -1):
        value = fma(value, x, coefficients[n])
    return value


@inline
def sincos(turns):
    """sin and cos of 2π · turns, of a number or a vector."""
    x = turns - rint(turns)
    return polynomial(x * x, _SIN) * x, polynomial(x * x, _COS)


@inline
def log(value):
    """Natural logarithm of a vector of positive numbers."""
    bits = bits_of(value)
    exponent = (bits - ROOT_HALF) >> MANTISSA
    f = bits_of(bits - (exponent << MANTISSA)) - ONE
    return to_floats(exponent) * LN_2 + f + f * f * (f * polynomial(f, _LOG) - HALF)


@inline
def exp(value):
    """Exponential function of a vector of numbers ≤ 0; at least 2⁻¹²⁶."""
    turns = max(value * (ONE / LN_2), LOWEST)
    whole = rint(turns)
    return polynomial(turns - whole, _EXP) * bits_of(to_ints(whole + BIAS, 2 * BIAS) << MANTISSA)


@inline
def wrap(difference, period):
    """The difference of two depths on a circle, in [−period/2, period/2]."""
    return fma(rint(difference * (ONE / period)), -period, difference)


@inline
def agreement(e, tolerance):
    """(1 − e² / tolerance)₊: how well two depths e bins apart agree, from 1 at e = 0 to 0 at e² = tolerance."""
    return max(ONE - e * e / tolerance, ZERO)
