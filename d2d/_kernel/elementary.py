"""Exponential and logarithm that loops over the lanes vectorise, and two bit operations."""

import math
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from d2d._kernel.compiling import part

_ROUND = 1.5 * 2.0**52  # adding it leaves the nearest integer in a double's lowest bits
_BIAS = 1023.0
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_C = tuple(1.0 / math.factorial(n) for n in range(14))


@intrinsic
def exponent_bits(typingctx: Any, number: Any) -> Any:
    """2^n from ``n + 1023 + 1.5 * 2^52``: the low bits of the sum become the exponent field."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        bits = builder.bitcast(args[0], ir.IntType(64))
        return builder.bitcast(builder.shl(bits, ir.Constant(ir.IntType(64), 52)), ir.DoubleType())

    return types.float64(types.float64), codegen


# Numba hands a caller's fastmath flags down unless the function sets its own, and reassociation
# would cancel the rounding constant.
@part(forceinline=True, fastmath={"contract"})
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
    return p * exponent_bits(shifted)


@intrinsic
def split(typingctx: Any, number: Any) -> Any:
    """Mantissa in [1, 2) and exponent of a positive normal number, both as doubles."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        word, real = ir.IntType(64), ir.DoubleType()
        bits = builder.bitcast(args[0], word)
        fraction = builder.and_(bits, ir.Constant(word, 0x000FFFFFFFFFFFFF))
        mantissa = builder.or_(fraction, ir.Constant(word, 0x3FF0000000000000))
        # the exponent field becomes the low bits of 2^52 + exponent
        field = builder.lshr(bits, ir.Constant(word, 52))
        shifted = builder.bitcast(builder.or_(field, ir.Constant(word, 0x4330000000000000)), real)
        exponent = builder.fsub(shifted, ir.Constant(real, 2.0**52 + 1023.0))
        return context.make_tuple(
            builder, signature.return_type, (builder.bitcast(mantissa, real), exponent)
        )

    return types.UniTuple(types.float64, 2)(types.float64), codegen


@part(forceinline=True, fastmath={"contract"})
def log(x: float) -> float:
    """log(x) of a positive normal number, by the artanh series; vectorises like `exp`.

    The absolute error is below 3e-16 near 1, the relative error below 3e-16 elsewhere.
    """
    m, n = split(x)
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


@intrinsic
def count_bits(typingctx: Any, number: Any) -> Any:
    """How many bits are set."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.ctpop(args[0])

    return types.int64(types.int64), codegen


@intrinsic
def lowest_bit(typingctx: Any, number: Any) -> Any:
    """Index of the lowest bit that is set; 64 if none is."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 0))

    return types.int64(types.int64), codegen
