"""Exponential and logarithm that loops over the lanes vectorise, and the lowest bit of a number."""

import math

import numpy as np

from d2d._kernel.compile import part

_ROUND = 1.5 * 2.0**52  # adding it leaves the nearest integer in a double's lowest bits
_BIAS = 1023.0
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_C = tuple(1.0 / math.factorial(n) for n in range(14))
_FRACTION, _ONE, _FIELD = (np.int64(bits) for bits in (2**52 - 1, 1023 << 52, 1075 << 52))
_SHIFT = np.int64(52)  # of the exponent field

# Numba hands a caller's fastmath flags down unless the function sets its own, and reassociation
# would cancel the rounding constant.
_exactly = part(forceinline=True, fastmath={"contract"})


@_exactly
def exp(x: float) -> float:
    """exp(x) for x <= 700 by range reduction and its Taylor polynomial of degree 13.

    Relative error below 3e-16; below -700 the result is cut off at 1e-304.  Unlike a call of the
    mathematics library, a loop over it compiles to vector instructions.
    """
    x = max(x, -700.0)
    shifted = x * 1.4426950408889634 + (_ROUND + _BIAS)
    n = shifted - (_ROUND + _BIAS)
    r = (x - n * _LN2_HIGH) - n * _LN2_LOW
    p = _C[13]
    p = p * r + _C[12]
    p = p * r + _C[11]
    p = p * r + _C[10]
    p = p * r + _C[9]
    p = p * r + _C[8]
    p = p * r + _C[7]
    p = p * r + _C[6]
    p = p * r + _C[5]
    p = p * r + _C[4]
    p = p * r + _C[3]
    p = p * r + _C[2]
    p = p * r + 1.0
    p = p * r + 1.0
    # 2^n: the lowest bits of ``shifted``, n + 1023, become the exponent field
    return p * np.int64(np.float64(shifted).view(np.int64) << _SHIFT).view(np.float64)


@_exactly
def log(x: float) -> float:
    """log(x) of a positive normal number, by the artanh series; vectorises like `exp`.

    The absolute error is below 3e-16 near 1, the relative error below 3e-16 elsewhere.
    """
    bits = np.float64(x).view(np.int64)
    m = np.int64((bits & _FRACTION) | _ONE).view(np.float64)  # the mantissa in [1, 2)
    # the exponent field becomes the lowest bits of 2^52
    n = np.int64((bits >> _SHIFT) | _FIELD).view(np.float64) - (2.0**52 + _BIAS)
    high = m > 1.4142135623730951
    m = 0.5 * m if high else m
    n = n + 1.0 if high else n
    r = (m - 1.0) / (m + 1.0)
    q = r * r
    p = 1.0 / 21.0
    p = p * q + 1.0 / 19.0
    p = p * q + 1.0 / 17.0
    p = p * q + 1.0 / 15.0
    p = p * q + 1.0 / 13.0
    p = p * q + 1.0 / 11.0
    p = p * q + 1.0 / 9.0
    p = p * q + 1.0 / 7.0
    p = p * q + 1.0 / 5.0
    p = p * q + 1.0 / 3.0
    return n * _LN2_HIGH + (2.0 * r + (2.0 * r * q * p + n * _LN2_LOW))


@_exactly
def lowest_bit(bits):
    """Index of the lowest bit that is set, of a number of at most 53 bits that is not zero."""
    lowest = np.float64(bits & -bits)  # a power of two
    return (lowest.view(np.int64) >> _SHIFT) - 1023
