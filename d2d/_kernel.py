"""The compiled double sum over targets and components, and Newton's method around it.

One pass over all pairs of a moving target ``k`` and a component ``i`` of the fixed mixture gives
the cost, its gradient and its Hessian.  Per pair, with the rotated mean ``p = R mu_k`` and the
rotated covariance ``C = R Sigma_k R'``::

    d = p + t - mu_i      S = C + Sigma_i      B = S^-1      u = B d      N = N(0 | d, S)

The derivatives of ``N`` in the rotation follow from those in ``d``, because the rotation turns
``S`` and ``dN/dS = N_dd / 2``.

Four techniques make it fast without changing the result:

* Targets are processed eight at a time, one per vector lane.  Their numbers are held in rows of a
  scratch array.  Each target is paired only with the components within its cut-off distance: a
  cheap first pass marks them as bits, they are copied side by side, and every step then adds one
  component to each target's sum.
* All components beyond the cut-off together contribute less than ``exp(-GATE)`` = 2e-16 of the
  target's density.  Minkowski's inequality,
  ``det(A + B)^(1/2) >= det(A)^(1/2) + det(B)^(1/2)``, bounds the normalisation of every pair by
  that of its component, ``w_i det(Sigma_i)^(-1/2) <= peak``, for any rotation.
* Factors that depend on the target alone are taken out of the sums over the components.
* The outlier component of a corrupted Gaussian has the same covariance for all pairs, so that six
  moments of its weights are enough.

Everything stays in the log domain, so that a target far from all components gives a large but
finite cost.

A one-dimensional set is stored as a planar one with ``y = 0`` and ``Syy = 1 / (2 pi)``, so that
its density along y is exactly 1.  Only ``t_x`` is then estimated.
"""

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

X, Y, XX, XY, YY, WEIGHT = range(6)  # rows of a packed point set
VALUE, VARIANCE, INPUT_VARIANCE, GAIN, SLOPE = 0, 1, 2, 3, 6  # columns of a packed measurement
NO_OUTLIER, UNIFORM, CORRUPTED = range(3)
LIKELIHOOD, SUMMING = range(2)

GATE = 36.0
NEAR = 12.5  # half the squared distance of five standard deviations
# The scratch array of a block of targets has rows of LANES numbers, one target per lane.  INLIER,
# OUTLIER, FACTOR and TOTAL each begin ten rows: the logarithm of a density, its gradient (G) and
# its second derivatives (A).
LANES = 8
G0, G1, G2, A00, A01, A11, A02, A12, A22 = range(LANES, 10 * LANES, LANES)
INLIER, OUTLIER, FACTOR, TOTAL = range(0, 40 * LANES, 10 * LANES)
MX, MY, CXX, CXY, CYY, COUNTS, CUTOFF, LIMIT, OFFSET, TOP = range(40 * LANES, 50 * LANES, LANES)
SQUARE, DETERMINANT, WITHIN = range(50 * LANES, 53 * LANES, LANES)
# The remaining rows hold copies of the components within the cut-off, six rows per step.  The
# components are tested in chunks, one bit for each: a double holds 53 bits exactly.
CHUNK = 48
STEP = 6 * LANES
STEPS = WITHIN + LANES
SCRATCH = STEPS + CHUNK * STEP
# Sums are scaled by exp(OFFSET), where OFFSET is the half squared distance of the nearest
# component.  Rounding must not make the nearest term vanish or overflow, however far away it is:
# all passes compute the distance by the same formula, OFFSET is slightly larger, and the exponent
# is capped.
MARGIN, MAX_EXPONENT = 1.0 + 1e-14, 200.0
TINY = 1e-300  # initial value of a sum that may have no terms: its logarithm stays finite
MIN_OUTLIER_SUM = 1e-180  # a smaller sum is computed again, scaled by the nearest component
# A pivot of the Hessian below this fraction of its diagonal entry counts as zero.  A motion that
# the targets do not determine leaves a pivot made of rounding errors and the residual gradient.
SINGULAR = 1e-8
UNIT_DENSITY_VARIANCE = 1.0 / (2.0 * math.pi)
LOG_2PI = math.log(2.0 * math.pi)

# Multiplications and additions may be fused ("contract") but not reordered.  LLVM would reorder
# them differently in the process that compiles and in the cached code, and the lanes vectorise
# without it.  NaN is assumed not to occur ("nnan"), so that min and max are single instructions.
_FAST = {"contract", "nnan"}
_ROUND = 1.5 * 2.0**52  # adding it leaves the nearest integer in a double's lowest bits
_BIAS = 1023.0
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_C = tuple(1.0 / math.factorial(n) for n in range(14))


@intrinsic
def _exponent_bits(typingctx: Any, number: Any) -> Any:
    """2^n from ``n + 1023 + 1.5 * 2^52``: the low bits of the sum become the exponent field."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        bits = builder.bitcast(args[0], ir.IntType(64))
        return builder.bitcast(builder.shl(bits, ir.Constant(ir.IntType(64), 52)), ir.DoubleType())

    return types.float64(types.float64), codegen


# A function without fastmath flags of its own inherits the caller's in Numba, and reassociation
# would cancel the rounding constant.
@njit(forceinline=True, fastmath={"contract"}, error_model="numpy")
def _exp(x: float) -> float:
    """exp(x) for x <= 700 by range reduction and a Taylor polynomial of degree 13.

    The relative error is below 3e-16; arguments below -700 give exp(-700) = 1e-304.  A loop over
    this function compiles to vector instructions, unlike one that calls the math library.
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
    return p * _exponent_bits(shifted)


@intrinsic
def _split(typingctx: Any, number: Any) -> Any:
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


@intrinsic
def _count_bits(typingctx: Any, number: Any) -> Any:
    """Number of set bits."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.ctpop(args[0])

    return types.int64(types.int64), codegen


@intrinsic
def _lowest_bit(typingctx: Any, number: Any) -> Any:
    """Index of the lowest set bit; 64 if none is set."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 0))

    return types.int64(types.int64), codegen


@njit(forceinline=True, fastmath={"contract"}, error_model="numpy")
def _log(x: float) -> float:
    """log(x) of a positive normal number, by the artanh series; vectorises like `_exp`.

    The absolute error is below 3e-16 near 1, the relative error below 3e-16 elsewhere.
    """
    m, n = _split(x)
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


@njit(forceinline=True, error_model="numpy")
def _chart(theta, in_twist):
    """Coordinates xi of the motion in which the measurements are linear, and their derivatives.

    They are either the motion's own parameters or its SE(2) logarithm: with beta = phi / 2 and
    a = beta cot(beta), xi = (a x + beta y, a y - beta x, phi).  Returns xi (3), the entries a, b,
    c, d of its Jacobian [[a, b, c], [-b, a, d], [0, 0, 1]], and db/dphi, da/dphi, d^2a/dphi^2.
    """
    x, y, phi = theta[0], theta[1], theta[2]
    if not in_twist:
        return x, y, phi, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    beta = 0.5 * phi
    if abs(phi) < 0.05:  # series, because the closed form suffers from cancellation
        s = phi * phi
        a = 1.0 - s * (1.0 / 12.0 + s * (1.0 / 720.0 + s / 30240.0))
        a1 = -phi * (1.0 / 6.0 + s * (1.0 / 180.0 + s / 5040.0))
        a2 = -(1.0 / 6.0 + s * (1.0 / 60.0 + s / 1008.0))
    else:
        sine, tangent = math.sin(beta), math.tan(beta)
        a = beta / tangent
        a1 = 0.5 * (1.0 / tangent - beta / (sine * sine))
        a2 = 0.5 * (a - 1.0) / (sine * sine)
    c, d = a1 * x + 0.5 * y, a1 * y - 0.5 * x
    return a * x + beta * y, a * y - beta * x, phi, a, beta, c, d, 0.5, a1, a2


@njit(forceinline=True, error_model="numpy")
def _through_chart(terms, theta, chart):
    """Chain rule: turn derivatives in the chart's coordinates into derivatives in the motion."""
    value, g0, g1, g2, h00, h01, h11, h02, h12, h22 = terms
    _, _, _, a, b, c, d, b1, a1, a2 = chart
    # H J, column by column
    m00, m10 = h00 * a - h01 * b, h01 * a - h11 * b
    m01, m11 = h00 * b + h01 * a, h01 * b + h11 * a
    m02, m12, m22 = h00 * c + h01 * d + h02, h01 * c + h11 * d + h12, h02 * c + h12 * d + h22
    return (
        value,
        a * g0 - b * g1,
        b * g0 + a * g1,
        c * g0 + d * g1 + g2,
        a * m00 - b * m10,
        a * m01 - b * m11,
        b * m01 + a * m11,
        a * m02 - b * m12 + a1 * g0 - b1 * g1,
        b * m02 + a * m12 + b1 * g0 + a1 * g1,
        c * m02 + d * m12 + m22 + a2 * (theta[0] * g0 + theta[1] * g1),
    )


@njit(forceinline=True, error_model="numpy")
def _factor_terms(factor, xi):
    """log N(z | h' xi, s^2 + q^2 (k' xi)^2) of one target, with its gradient and Hessian."""
    h0, h1, h2 = factor[GAIN], factor[GAIN + 1], factor[GAIN + 2]
    k0, k1, k2 = factor[SLOPE], factor[SLOPE + 1], factor[SLOPE + 2]
    residual = factor[VALUE] - h0 * xi[0] - h1 * xi[1] - h2 * xi[2]
    slope = k0 * xi[0] + k1 * xi[1] + k2 * xi[2]
    variance = factor[VARIANCE] + factor[INPUT_VARIANCE] * slope * slope
    e = residual / variance
    dv = 2.0 * factor[INPUT_VARIANCE] * slope  # d variance / d xi = dv k
    first = 0.5 * (e * e - 1.0 / variance)
    hk = -e / variance * dv
    kk = first * 2.0 * factor[INPUT_VARIANCE] - (e * e - 0.5 / variance) / variance * dv * dv
    hh = -1.0 / variance
    return (
        -0.5 * (residual * e + math.log(variance) + LOG_2PI),
        e * h0 + first * dv * k0,
        e * h1 + first * dv * k1,
        e * h2 + first * dv * k2,
        hh * h0 * h0 + 2.0 * hk * h0 * k0 + kk * k0 * k0,
        hh * h0 * h1 + hk * (h0 * k1 + h1 * k0) + kk * k0 * k1,
        hh * h1 * h1 + 2.0 * hk * h1 * k1 + kk * k1 * k1,
        hh * h0 * h2 + hk * (h0 * k2 + h2 * k0) + kk * k0 * k2,
        hh * h1 * h2 + hk * (h1 * k2 + h2 * k1) + kk * k1 * k2,
        hh * h2 * h2 + 2.0 * hk * h2 * k2 + kk * k2 * k2,
    )


@njit(forceinline=True, fastmath=_FAST, error_model="numpy")
def _load(w, lanes, turn, moving, order, first, d2d, planar):
    """Load the rotated means and covariances; an incomplete block repeats the last target."""
    cosine, sine = turn
    cc, cs, ss = cosine * cosine, cosine * sine, sine * sine
    last = order.shape[0] - 1
    for k in range(lanes):
        j = order[min(first + k, last)]
        x, y = moving[X, j], moving[Y, j]
        w[MX + k] = cosine * x - sine * y
        w[MY + k] = sine * x + cosine * y
        w[COUNTS + k] = 1.0 if first + k <= last else 0.0
        sxx, sxy, syy = moving[XX, j] * d2d, moving[XY, j] * d2d, moving[YY, j] * (d2d * planar)
        w[CXX + k] = cc * sxx - 2.0 * cs * sxy + ss * syy
        w[CXY + k] = cs * (sxx - syy) + (cc - ss) * sxy
        w[CYY + k] = ss * sxx + 2.0 * cs * sxy + cc * syy


@njit(forceinline=True, error_model="numpy")
def _lanes(w):
    """LANES as a value known only at run time.

    The compiler unrolls loops of known length and vectorises the others.
    """
    return w.shape[0] // (SCRATCH // LANES)


@njit(forceinline=True, fastmath=_FAST, error_model="numpy")
def _component(fixed, i, tx, ty):
    """Mean, minus the translation, and covariance of a component."""
    return fixed[X, i] - tx, fixed[Y, i] - ty, fixed[XX, i], fixed[XY, i], fixed[YY, i]


@njit(forceinline=True, fastmath=_FAST, error_model="numpy")
def _pair(w, k, component):
    """d and S of a pair, with d' adj(S) d and det(S), whose ratio is d' S^-1 d."""
    fx, fy, fxx, fxy, fyy = component
    dx, dy = w[MX + k] - fx, w[MY + k] - fy
    sxx, sxy, syy = w[CXX + k] + fxx, w[CXY + k] + fxy, w[CYY + k] + fyy
    square = syy * dx * dx - 2.0 * sxy * dx * dy + sxx * dy * dy
    return dx, dy, sxx, sxy, syy, square, sxx * syy - sxy * sxy


@njit(forceinline=True, fastmath=_FAST, error_model="numpy")
def _find_nearest(w, lanes, fixed, tx, ty):
    """Set OFFSET to MARGIN times the half squared distance of each target's nearest component.

    Squared Mahalanobis distances d' adj(S) d / det(S) are compared by cross-multiplication, without
    division.
    """
    for k in range(LANES):
        w[SQUARE + k], w[DETERMINANT + k] = 1.0, 0.0
    for i in range(fixed.shape[1]):
        component = _component(fixed, i, tx, ty)
        for k in range(lanes):
            _, _, _, _, _, square, determinant = _pair(w, k, component)
            old_square, old_determinant = w[SQUARE + k], w[DETERMINANT + k]
            nearer = square * old_determinant < old_square * determinant
            w[SQUARE + k] = square if nearer else old_square
            w[DETERMINANT + k] = determinant if nearer else old_determinant
    for k in range(lanes):
        w[OFFSET + k] = 0.5 * w[SQUARE + k] / w[DETERMINANT + k]
        w[OFFSET + k] *= MARGIN


@njit(forceinline=True, fastmath=_FAST, error_model="numpy")
def _find_within(w, lanes, fixed, tx, ty, first, last):
    """Mark the components within each target's cut-off as bits; return their largest number."""
    for k in range(lanes):
        w[WITHIN + k] = 0.0
    bit = 1.0
    for i in range(first, last):
        component = _component(fixed, i, tx, ty)
        for k in range(lanes):
            _, _, _, _, _, square, determinant = _pair(w, k, component)
            within = square <= w[CUTOFF + k] * determinant
            w[WITHIN + k] += bit if within else 0.0
        bit *= 2.0
    max_count = 0
    for k in range(LANES):
        max_count = max(max_count, _count_bits(int(w[WITHIN + k])))
    return max_count


@njit(forceinline=True, error_model="numpy")
def _gather_within(w, fixed, tx, ty, first, steps):
    """Copy the components within the cut-off into the rows of the steps, one per target and step.

    A target with none left gets a component at its own position with zero weight.
    """
    last = fixed.shape[1] - 1
    for k in range(LANES):
        bits = int(w[WITHIN + k])
        for at in range(STEPS + k, STEPS + k + steps * STEP, STEP):
            i = min(first + _lowest_bit(bits), last)
            more = bits != 0
            w[at + X * LANES] = fixed[X, i] - tx if more else w[MX + k]
            w[at + Y * LANES] = fixed[Y, i] - ty if more else w[MY + k]
            w[at + XX * LANES] = fixed[XX, i]
            w[at + XY * LANES] = fixed[XY, i]
            w[at + YY * LANES] = fixed[YY, i]
            w[at + WEIGHT * LANES] = fixed[WEIGHT, i] if more else 0.0
            bits &= bits - 1


@njit(forceinline=True, fastmath=_FAST, error_model="numpy")
def _add_step(w, lanes, step):
    """Add one pair of each target: w_i N(0 | d_i, S_i) exp(OFFSET) and its derivatives.

    By the heat equation, dN/dS = N_dd / 2 (Price 1958), all derivatives follow from those in d,
    which are N times polynomials in u = S^-1 d.  With D the derivative in d, turning S acts as the
    operator K = M : D D', M = [[-a, h], [h, a]].  The sums are those of N, D N, D D' N, K D N and
    K^2 N.
    """
    for k in range(lanes):
        component = (
            step[X * LANES + k],
            step[Y * LANES + k],
            step[XX * LANES + k],
            step[XY * LANES + k],
            step[YY * LANES + k],
        )
        dx, dy, sxx, sxy, syy, square, determinant = _pair(w, k, component)
        a, h = w[CXY + k], 0.5 * (w[CXX + k] - w[CYY + k])
        inverse = 1.0 / determinant
        half = 0.5 * square * inverse
        bxx, bxy, byy = syy * inverse, -sxy * inverse, sxx * inverse
        ux, uy = bxx * dx + bxy * dy, bxy * dx + byy * dy
        weight = step[WEIGHT * LANES + k] * math.sqrt(inverse)
        weight *= _exp(min(w[OFFSET + k] - half, MAX_EXPONENT))
        mx, my = h * uy - a * ux, h * ux + a * uy  # M u
        trace = a * (byy - bxx) + 2.0 * h * bxy  # tr(M B)
        turned = ux * mx + uy * my - trace  # K
        bmx, bmy = bxx * mx + bxy * my, bxy * mx + byy * my  # B M u
        w[INLIER + k] += weight
        w[INLIER + G0 + k] -= weight * ux
        w[INLIER + G1 + k] -= weight * uy
        w[INLIER + A00 + k] += weight * (ux * ux - bxx)
        w[INLIER + A01 + k] += weight * (ux * uy - bxy)
        w[INLIER + A11 + k] += weight * (uy * uy - byy)
        w[INLIER + A02 + k] += weight * (2.0 * bmx - ux * turned)
        w[INLIER + A12 + k] += weight * (2.0 * bmy - uy * turned)
        w[INLIER + A22 + k] += weight * (
            turned * turned
            - 4.0 * (mx * bmx + my * bmy)
            + 2.0 * (trace * trace + 2.0 * (a * a + h * h) * inverse)
        )


@njit(forceinline=True, fastmath=_FAST, error_model="numpy")
def _add_pairs(w, lanes, fixed, tx, ty):
    """Sum over the components within the cut-off; see `_add_step`."""
    for k in range(10 * LANES):
        w[INLIER + k] = 0.0
    for k in range(LANES):
        w[INLIER + k] = TINY
    for first in range(0, fixed.shape[1], CHUNK):
        last = min(first + CHUNK, fixed.shape[1])
        steps = _find_within(w, lanes, fixed, tx, ty, first, last)
        _gather_within(w, fixed, tx, ty, first, steps)
        for at in range(STEPS, STEPS + steps * STEP, STEP):
            _add_step(w, lanes, w[at : at + STEP])


@njit(forceinline=True, fastmath=_FAST, error_model="numpy")
def _sum_inliers(w, lanes, fixed, tx, ty, bounds):
    """log sum_i w_i N(0 | d_i, S_i), with its relative gradient and second derivatives.

    ``LIMIT`` is the half squared distance beyond which a target's pairs are negligible compared
    with its outlier component.  ``CUTOFF`` is the squared distance up to which pairs are summed.
    """
    log_peak, log_spread = bounds
    # Nearly always some component is so near that all beyond this limit are negligible.
    near_limit = NEAR + GATE + log_spread
    for k in range(lanes):
        w[CUTOFF + k] = 2.0 * min(w[LIMIT + k], near_limit)
        w[OFFSET + k] = 0.0
    min_sum = math.exp(log_peak - NEAR - log_spread)
    for again in range(2):
        _add_pairs(w, lanes, fixed, tx, ty)
        too_far = False
        for k in range(lanes):
            too_far |= (w[INLIER + k] < min_sum) & (w[LIMIT + k] > near_limit)
        if again or not too_far:
            break
        # no component is near: measure the cut-off from the nearest one
        _find_nearest(w, lanes, fixed, tx, ty)
        for k in range(lanes):
            w[CUTOFF + k] = 2.0 * min(w[LIMIT + k], w[OFFSET + k] + GATE + log_spread)
    for k in range(lanes):
        x, y, a, h = w[MX + k], w[MY + k], w[CXY + k], 0.5 * (w[CXX + k] - w[CYY + k])
        r = 1.0 / w[INLIER + k]
        g0, g1 = r * w[INLIER + G0 + k], r * w[INLIER + G1 + k]
        a00, a01, a11 = r * w[INLIER + A00 + k], r * w[INLIER + A01 + k], r * w[INLIER + A11 + k]
        k0, k1 = r * w[INLIER + A02 + k], r * w[INLIER + A12 + k]
        # d/dphi = d_phi . D + K with d_phi = (-y, x), d_phiphi = -(x, y) and
        # M_phi = 2 [[-h, -a], [-a, h]]; for D, K and M see `_add_step`
        w[INLIER + k] = _log(w[INLIER + k]) - w[OFFSET + k] - LOG_2PI
        w[INLIER + G0 + k] = g0
        w[INLIER + G1 + k] = g1
        w[INLIER + G2 + k] = x * g1 - y * g0 + a * (a11 - a00) + 2.0 * h * a01
        w[INLIER + A00 + k] = a00
        w[INLIER + A01 + k] = a01
        w[INLIER + A11 + k] = a11
        w[INLIER + A02 + k] = x * a01 - y * a00 + k0
        w[INLIER + A12 + k] = x * a11 - y * a01 + k1
        w[INLIER + A22 + k] = (
            y * y * a00
            - 2.0 * x * y * a01
            + x * x * a11
            + 2.0 * (x * k1 - y * k0)
            + r * w[INLIER + A22 + k]
            - x * g0
            - y * g1
            + 2.0 * h * (a11 - a00)
            - 4.0 * a * a01
        )


@njit(forceinline=True, fastmath=_FAST, error_model="numpy")
def _add_moments(w, lanes, fixed, tx, ty, bxx, bxy, byy):
    """Sum six moments, those of 1, d and d d', of the weights w_i exp(OFFSET - d' B d / 2)."""
    for k in range(6 * LANES):
        w[OUTLIER + k] = 0.0
    for i in range(fixed.shape[1]):
        fx, fy, own = fixed[X, i] - tx, fixed[Y, i] - ty, fixed[WEIGHT, i]
        for k in range(lanes):
            dx, dy = w[MX + k] - fx, w[MY + k] - fy
            half = 0.5 * (bxx * dx * dx + 2.0 * bxy * dx * dy + byy * dy * dy)
            v = own * _exp(min(w[OFFSET + k] - half, MAX_EXPONENT))
            w[OUTLIER + k] += v
            w[OUTLIER + G0 + k] += v * dx
            w[OUTLIER + G1 + k] += v * dy
            w[OUTLIER + G2 + k] += v * dx * dx
            w[OUTLIER + A00 + k] += v * dx * dy
            w[OUTLIER + A01 + k] += v * dy * dy


@njit(forceinline=True, fastmath=_FAST, error_model="numpy")
def _sum_outliers(w, lanes, fixed, tx, ty, outlier):
    """log of the outlier component, with its relative gradient and second derivatives."""
    bxx, bxy, byy = outlier[3], outlier[4], outlier[5]
    for k in range(LANES):
        w[OFFSET + k] = 0.0
    for again in range(2):
        _add_moments(w, lanes, fixed, tx, ty, bxx, bxy, byy)
        vanishing = False
        for k in range(lanes):
            vanishing |= w[OUTLIER + k] < MIN_OUTLIER_SUM
        if again or not vanishing:
            break
        for k in range(LANES):
            w[OFFSET + k] = np.inf
        for i in range(fixed.shape[1]):
            fx, fy = fixed[X, i] - tx, fixed[Y, i] - ty
            for k in range(lanes):
                dx, dy = w[MX + k] - fx, w[MY + k] - fy
                half = 0.5 * (bxx * dx * dx + 2.0 * bxy * dx * dy + byy * dy * dy)
                w[OFFSET + k] = min(w[OFFSET + k], MARGIN * half)
    for k in range(lanes):
        x, y, s = w[MX + k], w[MY + k], w[OUTLIER + k]
        r = 1.0 / s
        sx, sy = w[OUTLIER + G0 + k] * r, w[OUTLIER + G1 + k] * r
        sxx, sxy, syy = (
            w[OUTLIER + G2 + k] * r,
            w[OUTLIER + A00 + k] * r,
            w[OUTLIER + A01 + k] * r,
        )
        # E[u] and E[u u'] of u = B d; d_phi = (-y, x); L_t = -u; L_phi = -u' d_phi
        ux, uy = bxx * sx + bxy * sy, bxy * sx + byy * sy
        uxx = bxx * (bxx * sxx + bxy * sxy) + bxy * (bxx * sxy + bxy * syy)
        uxy = bxx * (bxy * sxx + byy * sxy) + bxy * (bxy * sxy + byy * syy)
        uyy = bxy * (bxy * sxx + byy * sxy) + byy * (bxy * sxy + byy * syy)
        bdx, bdy = bxy * x - bxx * y, byy * x - bxy * y  # B d_phi
        w[OUTLIER + k] = outlier[2] - w[OFFSET + k] + _log(s)
        w[OUTLIER + G0 + k] = -ux
        w[OUTLIER + G1 + k] = -uy
        w[OUTLIER + G2 + k] = y * ux - x * uy
        w[OUTLIER + A00 + k] = uxx - bxx
        w[OUTLIER + A01 + k] = uxy - bxy
        w[OUTLIER + A11 + k] = uyy - byy
        w[OUTLIER + A02 + k] = x * uxy - y * uxx - bdx
        w[OUTLIER + A12 + k] = x * uyy - y * uxy - bdy
        w[OUTLIER + A22 + k] = (
            y * y * uxx - 2.0 * x * y * uxy + x * x * uyy + y * bdx - x * bdy + x * ux + y * uy
        )


@njit(forceinline=True, error_model="numpy")
def _factors(w, lanes, theta, chart, factor, order, first):
    """Log-densities of the block's measurements, with their gradients and Hessians."""
    last = order.shape[0] - 1
    for k in range(lanes):
        j = order[min(first + k, last)]
        terms = _through_chart(_factor_terms(factor[j], chart), theta, chart)
        for row in range(10):
            w[FACTOR + row * LANES + k] = terms[row]


@njit(forceinline=True, fastmath=_FAST, error_model="numpy")
def _multiply(w, lanes):
    """Multiply the inlier densities by those of the measurements."""
    for k in range(lanes):
        f0, f1, f2 = w[FACTOR + G0 + k], w[FACTOR + G1 + k], w[FACTOR + G2 + k]
        g0, g1, g2 = w[INLIER + G0 + k], w[INLIER + G1 + k], w[INLIER + G2 + k]
        w[INLIER + k] += w[FACTOR + k]
        w[INLIER + G0 + k] += f0
        w[INLIER + G1 + k] += f1
        w[INLIER + G2 + k] += f2
        w[INLIER + A00 + k] += 2.0 * g0 * f0 + f0 * f0 + w[FACTOR + A00 + k]
        w[INLIER + A01 + k] += g0 * f1 + g1 * f0 + f0 * f1 + w[FACTOR + A01 + k]
        w[INLIER + A11 + k] += 2.0 * g1 * f1 + f1 * f1 + w[FACTOR + A11 + k]
        w[INLIER + A02 + k] += g0 * f2 + g2 * f0 + f0 * f2 + w[FACTOR + A02 + k]
        w[INLIER + A12 + k] += g1 * f2 + g2 * f1 + f1 * f2 + w[FACTOR + A12 + k]
        w[INLIER + A22 + k] += 2.0 * g2 * f2 + f2 * f2 + w[FACTOR + A22 + k]


@njit(forceinline=True, fastmath=_FAST, error_model="numpy")
def _mix(w, lanes, log_inlier_weight):
    """Add the outlier component to the inlier densities."""
    for k in range(lanes):
        # Shares p of the inlier and q of the outlier component, from the ratio of the smaller to
        # the larger.  A negligible share is set to zero: the curvature of its measurement would
        # otherwise make a plateau look like an optimum.
        inlier, other = log_inlier_weight + w[INLIER + k], w[OUTLIER + k]
        difference = other - inlier
        ratio = _exp(-abs(difference))
        ratio = 0.0 if abs(difference) > GATE else ratio
        larger = 1.0 / (1.0 + ratio)
        smaller = ratio * larger
        p, q = (smaller, larger) if difference > 0.0 else (larger, smaller)
        w[INLIER + k] = max(inlier, other) + _log(1.0 + ratio)
        w[INLIER + G0 + k] = p * w[INLIER + G0 + k] + q * w[OUTLIER + G0 + k]
        w[INLIER + G1 + k] = p * w[INLIER + G1 + k] + q * w[OUTLIER + G1 + k]
        w[INLIER + G2 + k] = p * w[INLIER + G2 + k] + q * w[OUTLIER + G2 + k]
        w[INLIER + A00 + k] = p * w[INLIER + A00 + k] + q * w[OUTLIER + A00 + k]
        w[INLIER + A01 + k] = p * w[INLIER + A01 + k] + q * w[OUTLIER + A01 + k]
        w[INLIER + A11 + k] = p * w[INLIER + A11 + k] + q * w[OUTLIER + A11 + k]
        w[INLIER + A02 + k] = p * w[INLIER + A02 + k] + q * w[OUTLIER + A02 + k]
        w[INLIER + A12 + k] = p * w[INLIER + A12 + k] + q * w[OUTLIER + A12 + k]
        w[INLIER + A22 + k] = p * w[INLIER + A22 + k] + q * w[OUTLIER + A22 + k]


@njit(forceinline=True, error_model="numpy")
def _block(
    w,
    lanes,
    theta,
    turn,
    chart,
    fixed,
    moving,
    order,
    first,
    bounds,
    d2d,
    planar,
    outlier,
    factor,
):
    """log q_k of a block of targets, its gradient (3), and q_k's second derivatives / q_k (6)."""
    tx, ty = theta[0], theta[1]
    kind, measured = outlier[0], factor.shape[0] > 0
    _load(w, lanes, turn, moving, order, first, d2d, planar)
    if measured:
        _factors(w, lanes, theta, chart, factor, order, first)
    if kind == CORRUPTED:
        _sum_outliers(w, lanes, fixed, tx, ty, outlier)
    elif kind == UNIFORM:
        for k in range(10 * LANES):
            w[OUTLIER + k] = 0.0
        for k in range(LANES):
            w[OUTLIER + k] = outlier[2]
    # LIMIT: beyond this half squared distance all pairs together are negligible compared with the
    # outlier component
    for k in range(LANES):
        w[LIMIT + k] = np.inf
        if kind != NO_OUTLIER:
            w[LIMIT + k] = GATE + outlier[1] + bounds[0] - LOG_2PI - w[OUTLIER + k]
            if measured:
                w[LIMIT + k] += w[FACTOR + k]
        if w[COUNTS + k] == 0.0:
            w[LIMIT + k] = -1.0
    _sum_inliers(w, lanes, fixed, tx, ty, bounds)
    if measured:
        _multiply(w, lanes)
    if kind != NO_OUTLIER:
        _mix(w, lanes, outlier[1])


@njit(error_model="numpy")
def _bounds(fixed, moving, extremes):
    """Logarithms of an upper bound on a sum over components and of its ratio to a lower bound.

    The upper bound holds for the sum of w_i det(S)^(-1/2) over all components, the lower bound for
    each of its terms, because det(S)^(1/2) <= tr(S) / 2.  ``extremes`` holds the largest
    w_i det(Sigma_i)^(-1/2), the smallest w_i and the largest trace of the fixed set.
    """
    trace = 0.0
    for k in range(moving.shape[1]):
        trace = max(trace, moving[XX, k] + moving[YY, k])
    peak = extremes[0] * fixed.shape[1]
    return math.log(peak), math.log(0.5 * peak * (extremes[2] + trace) / extremes[1])


@njit(forceinline=True, fastmath=_FAST, error_model="numpy")
def _add_logarithms(w, lanes):
    """Likelihood fusion: add log q_k and its derivatives to the totals."""
    for k in range(lanes):
        counts = w[COUNTS + k]
        g0, g1, g2 = w[INLIER + G0 + k], w[INLIER + G1 + k], w[INLIER + G2 + k]
        w[TOTAL + k] += counts * w[INLIER + k]
        w[TOTAL + G0 + k] += counts * g0
        w[TOTAL + G1 + k] += counts * g1
        w[TOTAL + G2 + k] += counts * g2
        w[TOTAL + A00 + k] += counts * (w[INLIER + A00 + k] - g0 * g0)
        w[TOTAL + A01 + k] += counts * (w[INLIER + A01 + k] - g0 * g1)
        w[TOTAL + A11 + k] += counts * (w[INLIER + A11 + k] - g1 * g1)
        w[TOTAL + A02 + k] += counts * (w[INLIER + A02 + k] - g0 * g2)
        w[TOTAL + A12 + k] += counts * (w[INLIER + A12 + k] - g1 * g2)
        w[TOTAL + A22 + k] += counts * (w[INLIER + A22 + k] - g2 * g2)


@njit(forceinline=True, fastmath=_FAST, error_model="numpy")
def _add_densities(w, lanes):
    """Summing fusion: add q_k exp(-top) and its derivatives; top is the largest log q_k so far."""
    for k in range(lanes):
        top = max(w[TOP + k], w[INLIER + k])
        keep = _exp(w[TOP + k] - top)
        own = w[COUNTS + k] * _exp(w[INLIER + k] - top)
        w[TOP + k] = top
        w[TOTAL + k] = keep * w[TOTAL + k] + own
        w[TOTAL + G0 + k] = keep * w[TOTAL + G0 + k] + own * w[INLIER + G0 + k]
        w[TOTAL + G1 + k] = keep * w[TOTAL + G1 + k] + own * w[INLIER + G1 + k]
        w[TOTAL + G2 + k] = keep * w[TOTAL + G2 + k] + own * w[INLIER + G2 + k]
        w[TOTAL + A00 + k] = keep * w[TOTAL + A00 + k] + own * w[INLIER + A00 + k]
        w[TOTAL + A01 + k] = keep * w[TOTAL + A01 + k] + own * w[INLIER + A01 + k]
        w[TOTAL + A11 + k] = keep * w[TOTAL + A11 + k] + own * w[INLIER + A11 + k]
        w[TOTAL + A02 + k] = keep * w[TOTAL + A02 + k] + own * w[INLIER + A02 + k]
        w[TOTAL + A12 + k] = keep * w[TOTAL + A12 + k] + own * w[INLIER + A12 + k]
        w[TOTAL + A22 + k] = keep * w[TOTAL + A22 + k] + own * w[INLIER + A22 + k]


@njit(forceinline=True, error_model="numpy")
def _total(w, row):
    total = 0.0
    for k in range(LANES):
        total += w[TOTAL + row + k]
    return total


@njit(error_model="numpy")
def _evaluate(
    theta,
    fixed,
    moving,
    order,
    bounds,
    d2d,
    planar,
    fusion,
    outlier,
    factor,
    in_twist,
    w,
    g,
    h,
):
    """Return the cost at theta; write its gradient to g (3) and its Hessian to h (3, 3)."""
    turn = (math.cos(theta[2]), math.sin(theta[2]))
    chart = _chart(theta, in_twist)
    for k in range(10 * LANES):
        w[TOTAL + k] = 0.0
    for k in range(LANES):
        w[TOP + k] = -np.inf
    lanes = _lanes(w)
    for first in range(0, moving.shape[1], LANES):
        _block(
            w,
            lanes,
            theta,
            turn,
            chart,
            fixed,
            moving,
            order,
            first,
            bounds,
            d2d,
            planar,
            outlier,
            factor,
        )
        if fusion == LIKELIHOOD:
            _add_logarithms(w, lanes)
        else:
            _add_densities(w, lanes)
    if fusion == SUMMING:
        top = -np.inf
        for k in range(LANES):
            top = max(top, w[TOP + k])
        for k in range(LANES):
            keep = math.exp(w[TOP + k] - top)
            for row in range(0, 10 * LANES, LANES):
                w[TOTAL + row + k] *= keep
    value = -_total(w, 0)
    g0, g1, g2 = _total(w, G0), _total(w, G1), _total(w, G2)
    a00, a01, a11 = _total(w, A00), _total(w, A01), _total(w, A11)
    a02, a12, a22 = _total(w, A02), _total(w, A12), _total(w, A22)
    if fusion == SUMMING:
        r = -1.0 / value
        value = -(top + math.log(-value))
        g0, g1, g2 = g0 * r, g1 * r, g2 * r
        a00, a01, a11 = a00 * r - g0 * g0, a01 * r - g0 * g1, a11 * r - g1 * g1
        a02, a12, a22 = a02 * r - g0 * g2, a12 * r - g1 * g2, a22 * r - g2 * g2
    if not planar:
        # t_y and phi do not exist in 1D: unit curvature keeps the Newton step along them at zero
        g1 = g2 = a01 = a02 = a12 = 0.0
        a11 = a22 = -1.0
    g[0], g[1], g[2] = -g0, -g1, -g2
    h[0, 0], h[1, 1], h[2, 2] = -a00, -a11, -a22
    h[0, 1] = h[1, 0] = -a01
    h[0, 2] = h[2, 0] = -a02
    h[1, 2] = h[2, 1] = -a12
    return value


@njit(error_model="numpy")
def _shifted_solve(h, g, shift, scale, step):
    """Solve (H + shift diag(scale)) step = -g by L D L'.

    Returns whether the matrix is positive definite, and -1/2 d(|step|^2)/d(shift) in the scaled
    norm, which the search for the shift needs.
    """
    d0 = h[0, 0] + shift * scale[0]
    d1 = h[1, 1] + shift * scale[1]
    d2 = h[2, 2] + shift * scale[2]
    floor0, floor1, floor2 = (
        SINGULAR * abs(h[0, 0]),
        SINGULAR * abs(h[1, 1]),
        SINGULAR * abs(h[2, 2]),
    )
    if not d0 > floor0:
        return False, 0.0
    l10, l20 = h[1, 0] / d0, h[2, 0] / d0
    d1 -= l10 * h[1, 0]
    if not d1 > floor1:
        return False, 0.0
    e21 = h[2, 1] - l20 * h[1, 0]
    l21 = e21 / d1
    d2 -= l20 * h[2, 0] + l21 * e21
    if not d2 > floor2:
        return False, 0.0
    y0 = -g[0]
    y1 = -g[1] - l10 * y0
    y2 = -g[2] - l20 * y0 - l21 * y1
    s2 = y2 / d2
    s1 = y1 / d1 - l21 * s2
    s0 = y0 / d0 - l10 * s1 - l20 * s2
    step[0], step[1], step[2] = s0, s1, s2
    # the derivative is step' W (H + shift W)^-1 W step with W = diag(scale): the squared norm of
    # z = L^-1 W step, weighted by the inverse pivots
    z0 = scale[0] * s0
    z1 = scale[1] * s1 - l10 * z0
    z2 = scale[2] * s2 - l20 * z0 - l21 * z1
    return True, z0 * z0 / d0 + z1 * z1 / d1 + z2 * z2 / d2


@njit(error_model="numpy")
def _invert(h, unit, column, inverse):
    """Inverse of a positive definite matrix, column by column; exactly symmetric."""
    unit[0] = unit[1] = unit[2] = 0.0
    for j in range(3):
        unit[j] = -1.0
        _shifted_solve(h, unit, 0.0, unit, column)
        unit[j] = 0.0
        for i in range(j, 3):
            inverse[i, j] = inverse[j, i] = column[i]


@njit(error_model="numpy")
def _decrease(h, g, step):
    """Decrease -g' step - step' H step / 2 of the quadratic model."""
    total = 0.0
    for i in range(3):
        row = g[i]
        for j in range(3):
            row += 0.5 * h[i, j] * step[j]
        total -= step[i] * row
    return total


@njit(error_model="numpy")
def _inner(a, b, scale):
    """a' diag(scale) b."""
    return a[0] * scale[0] * b[0] + a[1] * scale[1] * b[1] + a[2] * scale[2] * b[2]


@njit(error_model="numpy")
def _step_to_boundary(h, g, shift, scale, radius, perturbation, step):
    """Extend the step in the hard case: the gradient misses the Hessian's lowest eigenvector.

    The step of an indefinite Hessian then stays within the radius, however near the shift comes to
    the lowest eigenvalue.  Going on along the eigenvector lowers the model further; the nearly
    singular system amplifies it in any ``perturbation``.
    """
    along, right = np.empty(3), np.empty(3)
    definite, _ = _shifted_solve(h, g, 0.0, scale, along)
    norm = math.sqrt(_inner(step, step, scale))
    if definite or norm >= 0.9 * radius:
        return
    for i in range(3):
        right[i] = perturbation[i] * math.sqrt(scale[i])
    solved, _ = _shifted_solve(h, right, shift, scale, along)
    if not solved:
        return
    size = math.sqrt(_inner(along, along, scale))
    inner = _inner(along, step, scale) / size
    root = math.sqrt(inner * inner + radius * radius - norm * norm)
    forward, backward = np.empty(3), np.empty(3)
    for i in range(3):
        forward[i] = step[i] + (root - inner) / size * along[i]
        backward[i] = step[i] - (root + inner) / size * along[i]
    best = forward if _decrease(h, g, forward) > _decrease(h, g, backward) else backward
    step[0], step[1], step[2] = best[0], best[1], best[2]


@njit(error_model="numpy")
def _trust_region_step(h, g, scale, radius, perturbation, step):
    """Minimise the quadratic model within the radius (Moré & Sorensen 1983); return its decrease.

    The shift of the Hessian is bracketed by Gershgorin circles and found by Newton's method on
    1/|step|.  A step length within a tenth of the radius is all that a trust region needs.
    """
    step[0] = step[1] = step[2] = 0.0
    norm_g = math.sqrt(g[0] * g[0] / scale[0] + g[1] * g[1] / scale[1] + g[2] * g[2] / scale[2])
    low, high = 0.0, 0.0
    for i in range(3):
        off = 0.0
        for j in range(3):
            if j != i:
                off += abs(h[i, j]) / math.sqrt(scale[i] * scale[j])
        diagonal = h[i, i] / scale[i]
        low = max(low, -diagonal)
        high = max(high, abs(diagonal) + off)
    high += norm_g / radius
    shift = 0.0 if low == 0.0 else low + 1e-3 * (high - low)
    for _ in range(60):
        definite, slope = _shifted_solve(h, g, shift, scale, step)
        if not definite:
            low = shift
            shift = max(0.5 * (low + high), 1e-3 * high) if low == 0.0 else 0.5 * (low + high)
            continue
        norm = math.sqrt(_inner(step, step, scale))
        if abs(norm - radius) <= 0.1 * radius or (norm < radius and shift == 0.0):
            break
        if norm > radius:
            low = shift
        else:
            high = shift
        if high - low <= 1e-10 * high:
            break
        newton = shift + (norm - radius) / radius * norm * norm / slope if slope > 0.0 else low
        shift = newton if low < newton < high else 0.5 * (low + high)
    if not definite:
        _shifted_solve(h, g, high, scale, step)
    _step_to_boundary(h, g, high, scale, radius, perturbation, step)
    return _decrease(h, g, step)


@njit(error_model="numpy")
def _first_radius(fixed, moving, d2d, planar, scale):
    """Three times the typical standard deviation of a pair, within most basins of attraction.

    Also fills ``scale``, which weights a rotation by the displacement that it causes.
    """
    variance = lever = 0.0
    for i in range(fixed.shape[1]):
        variance += (fixed[XX, i] + (fixed[YY, i] if planar else 0.0)) / fixed.shape[1]
    for k in range(moving.shape[1]):
        if d2d:
            variance += (moving[XX, k] + (moving[YY, k] if planar else 0.0)) / moving.shape[1]
        lever += (moving[X, k] ** 2 + moving[Y, k] ** 2) / moving.shape[1]
    scale[0] = scale[1] = 1.0
    scale[2] = lever if planar and lever > 0.0 else 1.0
    return 3.0 * math.sqrt(variance)


@njit(error_model="numpy")
def _minimise(
    theta,
    fixed,
    moving,
    order,
    extremes,
    d2d,
    planar,
    fusion,
    outlier,
    factor,
    in_twist,
    tolerance,
    max_iterations,
    work,
    g,
    h,
):
    """Newton's method in a trust region, in place; returns (value, converged, iterations).

    A step is taken only if it lowers the cost, so the result is never worse than the start.
    ``converged`` means that the Hessian is positive definite and that either the Newton decrement
    g' H^-1 g (the squared distance to the optimum in estimated standard deviations) is within the
    tolerance, or the step can no longer lower the cost in floating point.
    """
    w, step, scale, perturbation, trial, trial_g, trial_h = work
    # a generic direction, so that it is not orthogonal to the lowest eigenvector
    perturbation[0], perturbation[1], perturbation[2] = 1.0, 0.7 * planar, 0.4 * planar
    bounds = _bounds(fixed, moving, extremes)
    radius = _first_radius(fixed, moving, d2d, planar, scale)
    value = _evaluate(
        theta,
        fixed,
        moving,
        order,
        bounds,
        d2d,
        planar,
        fusion,
        outlier,
        factor,
        in_twist,
        w,
        g,
        h,
    )
    for iteration in range(max_iterations):
        if not math.isfinite(value):
            return value, False, iteration
        definite, _ = _shifted_solve(h, g, 0.0, scale, step)
        decrement = -(g[0] * step[0] + g[1] * step[1] + g[2] * step[2]) if definite else np.inf
        if decrement <= tolerance:
            return value, True, iteration
        norm = math.sqrt(_inner(step, step, scale))
        if definite and norm <= radius:
            decrease = 0.5 * decrement
        else:
            decrease = _trust_region_step(h, g, scale, radius, perturbation, step)
            norm = math.sqrt(_inner(step, step, scale))
        for j in range(3):
            trial[j] = theta[j] + step[j]
        trial_value = _evaluate(
            trial,
            fixed,
            moving,
            order,
            bounds,
            d2d,
            planar,
            fusion,
            outlier,
            factor,
            in_twist,
            w,
            trial_g,
            trial_h,
        )
        gain = value - trial_value
        if decrease <= 2e-15 * (abs(value) + moving.shape[1]) and not gain > 0.0:
            return value, definite, iteration + 1
        ratio = gain / decrease if decrease > 0.0 else -1.0
        if not ratio >= 0.25:
            radius = 0.25 * min(norm, radius)
        elif ratio > 0.75 and norm > 0.8 * radius:
            radius *= 2.0
        if gain > 0.0:
            value = trial_value
            for j in range(3):
                theta[j] = trial[j]
                g[j] = trial_g[j]
                for i in range(3):
                    h[i, j] = trial_h[i, j]
        elif norm == 0.0:
            return value, False, iteration + 1
    return value, False, max_iterations


@njit(cache=True, nogil=True, error_model="numpy")
def find_extremes_batch(sets, extremes):
    """The largest w_i det(Sigma_i)^(-1/2), smallest w_i and largest tr(Sigma_i) of every set."""
    for b in range(sets.shape[0]):
        points = sets[b]
        peak, weight, trace = 0.0, np.inf, 0.0
        for i in range(points.shape[1]):
            xx, xy, yy = points[XX, i], points[XY, i], points[YY, i]
            peak = max(peak, points[WEIGHT, i] / math.sqrt(xx * yy - xy * xy))
            weight = min(weight, points[WEIGHT, i])
            trace = max(trace, xx + yy)
        extremes[b, 0], extremes[b, 1], extremes[b, 2] = peak, weight, trace


@njit(cache=True, nogil=True, error_model="numpy")
def evaluate_batch(
    thetas,
    fixed,
    moving,
    orders,
    extremes,
    which,
    d2d,
    planar,
    fusion,
    outlier,
    factors,
    in_twist,
    value,
    gradient,
    hessian,
):
    """Cost, gradient and Hessian of every problem.

    ``which`` (B, 3) holds the indices of each problem's fixed set, moving set and measurement.
    """
    w = np.empty(SCRATCH)
    for b in range(thetas.shape[0]):
        value[b] = _evaluate(
            thetas[b],
            fixed[which[b, 0]],
            moving[which[b, 1]],
            orders[which[b, 1]],
            _bounds(fixed[which[b, 0]], moving[which[b, 1]], extremes[which[b, 0]]),
            d2d,
            planar,
            fusion,
            outlier,
            factors[which[b, 2]],
            in_twist,
            w,
            gradient[b],
            hessian[b],
        )


@njit(cache=True, nogil=True, error_model="numpy")
def log_density_batch(
    thetas,
    fixed,
    moving,
    orders,
    extremes,
    which,
    d2d,
    planar,
    outlier,
    factors,
    in_twist,
    log_density,
):
    """log q_k of every target of every problem."""
    w = np.empty(SCRATCH)
    lanes = _lanes(w)
    for b in range(thetas.shape[0]):
        turn = (math.cos(thetas[b, 2]), math.sin(thetas[b, 2]))
        chart = _chart(thetas[b], in_twist)
        order = orders[which[b, 1]]
        bounds = _bounds(fixed[which[b, 0]], moving[which[b, 1]], extremes[which[b, 0]])
        for first in range(0, moving.shape[2], LANES):
            _block(
                w,
                lanes,
                thetas[b],
                turn,
                chart,
                fixed[which[b, 0]],
                moving[which[b, 1]],
                order,
                first,
                bounds,
                d2d,
                planar,
                outlier,
                factors[which[b, 2]],
            )
            for k in range(min(LANES, moving.shape[2] - first)):
                log_density[b, order[first + k]] = w[INLIER + k]


@njit(cache=True, nogil=True, error_model="numpy")
def minimise_batch(
    thetas,
    fixed,
    moving,
    orders,
    extremes,
    which,
    d2d,
    planar,
    fusion,
    outlier,
    factors,
    in_twist,
    tolerance,
    max_iterations,
    value,
    gradient,
    hessian,
    covariance,
    converged,
    iterations,
):
    """Minimise every problem of the batch separately.

    ``thetas`` holds the starts and receives the optima.
    """
    # allocated once: step, scale, perturbation, trial, its gradient and its Hessian
    vectors, trial_h = np.empty((5, 3)), np.empty((3, 3))
    work = (
        np.empty(SCRATCH),
        vectors[0],
        vectors[1],
        vectors[2],
        vectors[3],
        vectors[4],
        trial_h,
    )
    for b in range(thetas.shape[0]):
        value[b], converged[b], iterations[b] = _minimise(
            thetas[b],
            fixed[which[b, 0]],
            moving[which[b, 1]],
            orders[which[b, 1]],
            extremes[which[b, 0]],
            d2d,
            planar,
            fusion,
            outlier,
            factors[which[b, 2]],
            in_twist,
            tolerance,
            max_iterations,
            work,
            gradient[b],
            hessian[b],
        )
        if converged[b]:
            _invert(hessian[b], vectors[3], vectors[4], covariance[b])
