"""The compiled double sum over targets and components, and the Newton iteration around it.

One pass over all pairs of a moving target ``k`` and a component ``i`` of the fixed mixture gives
the cost, its gradient and its Hessian.  Per pair, with the rotated mean ``p = R mu_k`` and the
rotated covariance ``C = R Sigma_k R'``::

    d = p + t - mu_i      S = C + Sigma_i      B = S^-1      u = B d      L = log N(0 | d, S)

and the derivatives of ``L`` follow from ``R' = E R`` with ``E = [[0, -1], [1, 0]]``.

Three things make it fast without changing the result:

* The sets are packed one quantity per row (x, y, Sxx, Sxy, Syy, weight), so that the loops over the
  components compile to vector instructions.
* A pair is skipped once its density is surely below ``exp(-GATE)`` of its target's largest one.
  ``det(A + B)^(1/2) >= det(A)^(1/2) + det(B)^(1/2)`` (Minkowski) bounds the normalisation of every
  pair by that of the component alone, ``w_i det(Sigma_i)^(-1/2) <= peak``, for any rotation.  All
  skipped pairs of a target together change its density by less than ``exp(-GATE)`` = 2e-16 of it.
* The corrupted Gaussian has one covariance for all pairs: six moments of its weights are enough.

Everything stays in the log domain: a target far from everything gives a large finite cost.

A one-dimensional set is stored as a planar one with ``y = 0`` and ``Syy = 1 / (2 pi)``, whose
density along y is exactly 1; only ``t_x`` then moves.
"""

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

X, Y, XX, XY, YY, WEIGHT = range(6)  # rows of a packed point set
VALUE, VARIANCE, INPUT_VARIANCE, GAIN, SLOPE = 0, 1, 2, 3, 6  # columns of a packed factor
NO_OUTLIER, UNIFORM, CORRUPTED = range(3)
LIKELIHOOD, SUMMING = range(2)

GATE = 36.0
FARTHEST = 1e-200  # moments below it are taken again, relative to the nearest component
# A pivot of the Hessian below this part of its diagonal counts as zero: a motion that the targets
# do not show leaves pivots of rounding errors and of the residual gradient there.
SINGULAR = 1e-8
UNIT_DENSITY_VARIANCE = 1.0 / (2.0 * math.pi)
LOG_2PI = math.log(2.0 * math.pi)

# Sums may be reordered and divisions shared, but inf keeps its meaning.
_FAST = {"reassoc", "contract", "arcp", "nsz"}
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


# Numba hands a caller's fastmath flags down unless the function sets its own, and reassociation
# would cancel the rounding constant.
@njit(forceinline=True, fastmath={"contract"}, error_model="numpy")
def _exp(x: float) -> float:
    """exp(x) for x <= 0 by range reduction and its Taylor polynomial of degree 13.

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
    return p * _exponent_bits(shifted)


@njit(forceinline=True, fastmath=_FAST | {"nnan"}, error_model="numpy")
def _half_distances(fixed, px, py, cxx, cxy, cyy, half):
    """Half the squared Mahalanobis distance of one target to every component; the smallest."""
    n = fixed.shape[1]
    for i in range(n):
        dx, dy = px - fixed[X, i], py - fixed[Y, i]
        sxx, sxy, syy = cxx + fixed[XX, i], cxy + fixed[XY, i], cyy + fixed[YY, i]
        square = syy * dx * dx - 2.0 * sxy * dx * dy + sxx * dy * dy
        half[i] = 0.5 * square / (sxx * syy - sxy * sxy)
    # a loop of its own: the minimum must be the very number that was stored
    lowest = np.inf
    for i in range(n):
        lowest = min(lowest, half[i])
    return lowest


@njit(forceinline=True, fastmath=_FAST | {"nnan"}, error_model="numpy")
def _outlier_moments(fixed, px, py, bxx, bxy, byy, offset):
    """The six moments, of 1, d and d d', of the weights w_i exp(offset - d' B d / 2)."""
    s = sx = sy = sxx = sxy = syy = 0.0
    for i in range(fixed.shape[1]):
        dx, dy = px - fixed[X, i], py - fixed[Y, i]
        h = 0.5 * (bxx * dx * dx + 2.0 * bxy * dx * dy + byy * dy * dy)
        v = fixed[WEIGHT, i] * _exp(offset - h)
        s += v
        sx += v * dx
        sy += v * dy
        sxx += v * dx * dx
        sxy += v * dx * dy
        syy += v * dy * dy
    return s, sx, sy, sxx, sxy, syy


@njit(error_model="numpy")
def _far_outlier_moments(fixed, px, py, bxx, bxy, byy):
    """The moments where every component is so far that they would vanish; and their offset."""
    offset = np.inf
    for i in range(fixed.shape[1]):
        dx, dy = px - fixed[X, i], py - fixed[Y, i]
        offset = min(offset, 0.5 * (bxx * dx * dx + 2.0 * bxy * dx * dy + byy * dy * dy))
    return offset, _outlier_moments(fixed, px, py, bxx, bxy, byy, offset)


@njit(forceinline=True, error_model="numpy")
def _outlier_component(fixed, outlier, px, py, x, y):
    """log of the corrupted Gaussian's component, its relative gradient and second derivatives."""
    bxx, bxy, byy = outlier[3], outlier[4], outlier[5]
    offset = 0.0
    s, sx, sy, sxx, sxy, syy = _outlier_moments(fixed, px, py, bxx, bxy, byy, offset)
    if s < FARTHEST:
        offset, moments = _far_outlier_moments(fixed, px, py, bxx, bxy, byy)
        s, sx, sy, sxx, sxy, syy = moments
    sx, sy, sxx, sxy, syy = sx / s, sy / s, sxx / s, sxy / s, syy / s
    # E[u] and E[u u'] of u = B d; d_phi = (-y, x); L_t = -u; L_phi = -u' d_phi
    ux, uy = bxx * sx + bxy * sy, bxy * sx + byy * sy
    uxx = bxx * (bxx * sxx + bxy * sxy) + bxy * (bxx * sxy + bxy * syy)
    uxy = bxx * (bxy * sxx + byy * sxy) + bxy * (bxy * sxy + byy * syy)
    uyy = bxy * (bxy * sxx + byy * sxy) + byy * (bxy * sxy + byy * syy)
    bdx, bdy = bxy * x - bxx * y, byy * x - bxy * y  # B d_phi
    return (
        outlier[2] - offset + math.log(s),
        -ux,
        -uy,
        y * ux - x * uy,
        uxx - bxx,
        uxy - bxy,
        uyy - byy,
        x * uxy - y * uxx - bdx,
        x * uyy - y * uxy - bdy,
        y * y * uxx - 2.0 * x * y * uxy + x * x * uyy + y * bdx - x * bdy + x * ux + y * uy,
    )


@njit(forceinline=True, error_model="numpy")
def _chart(theta, in_twist):
    """Coordinates xi of the motion in which the measurements are linear, and their derivatives.

    Either the motion's own parameters or its SE(2) logarithm: with beta = phi / 2 and
    a = beta cot(beta), xi = (a x + beta y, a y - beta x, phi).  Returns xi (3), the entries a, b,
    c, d of its Jacobian [[a, b, c], [-b, a, d], [0, 0, 1]], and db/dphi, da/dphi, d^2a/dphi^2.
    """
    x, y, phi = theta[0], theta[1], theta[2]
    if not in_twist:
        return x, y, phi, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    beta = 0.5 * phi
    if abs(phi) < 0.05:  # series: the closed form cancels
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
    """Chain rule: derivatives in the chart's coordinates to derivatives in the motion."""
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
    """log N(z | h' xi, s^2 + q^2 (k' xi)^2) of one target, its gradient and Hessian."""
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
def _inlier_component(fixed, px, py, x, y, cxx, cxy, cyy, half, near, lowest, gate):
    """log sum_i w_i N(0 | d_i, S_i), its relative gradient and second derivatives."""
    a, b = cxy, cxx - cyy  # C_phi = [[-2a, b], [b, 2a]], C_phiphi = [[-2b, -4a], [-4a, 2b]]
    s = g0 = g1 = g2 = a00 = a01 = a11 = a02 = a12 = a22 = 0.0
    # gather the pairs that matter first: the loop over them then compiles to vector instructions
    count = 0
    for i in range(fixed.shape[1]):
        near[count] = i
        count += half[i] <= gate
    for j in range(count):
        i = near[j]
        dx, dy = px - fixed[X, i], py - fixed[Y, i]
        sxx, sxy, syy = cxx + fixed[XX, i], cxy + fixed[XY, i], cyy + fixed[YY, i]
        inverse = 1.0 / (sxx * syy - sxy * sxy)
        weight = fixed[WEIGHT, i] * math.sqrt(inverse) * _exp(lowest - half[i])
        bxx, bxy, byy = syy * inverse, -sxy * inverse, sxx * inverse
        ux, uy = bxx * dx + bxy * dy, bxy * dx + byy * dy
        vx, vy = 2.0 * a * ux - b * uy - y, x - b * ux - 2.0 * a * uy  # v = d_phi - C_phi u
        bvx, bvy = bxx * vx + bxy * vy, bxy * vx + byy * vy
        difference, product = uy * uy - ux * ux, ux * uy
        trace = 2.0 * a * (byy - bxx) + 2.0 * b * bxy  # tr(B C_phi)
        l2 = y * ux - x * uy + a * difference + b * product - 0.5 * trace
        l22 = (
            -(vx * bvx + vy * bvy)
            + (x * ux + y * uy)
            + b * difference
            - 4.0 * a * product
            - b * (byy - bxx)
            + 4.0 * a * bxy
            + 0.5 * trace * trace
            + (4.0 * a * a + b * b) * inverse
        )
        s += weight
        g0 -= weight * ux
        g1 -= weight * uy
        g2 += weight * l2
        a00 += weight * (ux * ux - bxx)
        a01 += weight * (ux * uy - bxy)
        a11 += weight * (uy * uy - byy)
        a02 -= weight * (bvx + ux * l2)
        a12 -= weight * (bvy + uy * l2)
        a22 += weight * (l22 + l2 * l2)
    r = 1.0 / s
    return (
        math.log(s) - lowest - LOG_2PI,
        g0 * r,
        g1 * r,
        g2 * r,
        a00 * r,
        a01 * r,
        a11 * r,
        a02 * r,
        a12 * r,
        a22 * r,
    )


@njit(forceinline=True, error_model="numpy")
def _target(
    theta, turn, chart, fixed, moving, k, log_peak, d2d, planar, outlier, factor, half, near
):
    """log q_k with its gradient (3) and second derivatives of q_k over q_k (6)."""
    cosine, sine = turn
    mx, my = moving[X, k], moving[Y, k]
    x, y = cosine * mx - sine * my, sine * mx + cosine * my
    px, py = x + theta[0], y + theta[1]
    cxx = cxy = cyy = 0.0
    if d2d:
        sxx, sxy, syy = moving[XX, k], moving[XY, k], moving[YY, k]
        if planar:
            cc, cs, ss = cosine * cosine, cosine * sine, sine * sine
            cxx = cc * sxx - 2.0 * cs * sxy + ss * syy
            cxy = cs * (sxx - syy) + (cc - ss) * sxy
            cyy = ss * sxx + 2.0 * cs * sxy + cc * syy
        else:
            cxx = sxx  # along y the fixed set alone has the variance of unit density

    lowest = _half_distances(fixed, px, py, cxx, cxy, cyy, half)

    extra = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    has_factor = factor.shape[0] > 0
    if has_factor:
        extra = _through_chart(_factor_terms(factor[k], chart), theta, chart)
    kind = outlier[0]
    if kind == UNIFORM:
        other = (outlier[2], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    elif kind == CORRUPTED:
        other = _outlier_component(fixed, outlier, px, py, x, y)
    else:
        other = (-np.inf, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    # The whole inlier part may be too far to matter beside the outlier component.
    bound = outlier[1] + extra[0] + log_peak - lowest - LOG_2PI
    if bound < other[0] - GATE:
        return other

    # Of the nearest component's density only its normalisation is unknown: bound it from below by
    # the Hadamard inequality det(S) <= Sxx Syy over all components, cheap and never too tight.
    nearest = np.inf
    gate = lowest
    for i in range(fixed.shape[1]):
        if half[i] == lowest:
            sxx, syy = cxx + fixed[XX, i], cyy + fixed[YY, i]
            nearest = fixed[WEIGHT, i] / math.sqrt(sxx * syy)
            gate = lowest + GATE + log_peak - math.log(nearest)
            break

    inner = _inlier_component(fixed, px, py, x, y, cxx, cxy, cyy, half, near, lowest, gate)
    if has_factor:
        f0, f1, f2 = extra[1], extra[2], extra[3]
        g0, g1, g2 = inner[1], inner[2], inner[3]
        inner = (
            inner[0] + extra[0],
            g0 + f0,
            g1 + f1,
            g2 + f2,
            inner[4] + 2.0 * g0 * f0 + f0 * f0 + extra[4],
            inner[5] + g0 * f1 + g1 * f0 + f0 * f1 + extra[5],
            inner[6] + 2.0 * g1 * f1 + f1 * f1 + extra[6],
            inner[7] + g0 * f2 + g2 * f0 + f0 * f2 + extra[7],
            inner[8] + g1 * f2 + g2 * f1 + f1 * f2 + extra[8],
            inner[9] + 2.0 * g2 * f2 + f2 * f2 + extra[9],
        )
    if kind == NO_OUTLIER:
        return inner

    # shares p of the inlier and q of the outlier component, from the smaller over the larger one
    log_inlier = outlier[1] + inner[0]
    difference = other[0] - log_inlier
    ratio = math.exp(-abs(difference))
    p, q = 1.0 / (1.0 + ratio), ratio / (1.0 + ratio)
    if difference > 0.0:
        p, q = q, p
    return (
        max(log_inlier, other[0]) + math.log1p(ratio),
        p * inner[1] + q * other[1],
        p * inner[2] + q * other[2],
        p * inner[3] + q * other[3],
        p * inner[4] + q * other[4],
        p * inner[5] + q * other[5],
        p * inner[6] + q * other[6],
        p * inner[7] + q * other[7],
        p * inner[8] + q * other[8],
        p * inner[9] + q * other[9],
    )


@njit(error_model="numpy")
def _evaluate(
    theta, fixed, moving, peak, d2d, planar, fusion, outlier, factor, in_twist, half, near, g, h
):
    """Cost at theta; its gradient goes to g (3), its Hessian to h (3, 3)."""
    turn = (math.cos(theta[2]), math.sin(theta[2]))
    chart = _chart(theta, in_twist)
    log_peak = math.log(peak * fixed.shape[1])
    value = g0 = g1 = g2 = a00 = a01 = a11 = a02 = a12 = a22 = 0.0
    top, total = -np.inf, 0.0
    for k in range(moving.shape[1]):
        q = _target(
            theta, turn, chart, fixed, moving, k, log_peak, d2d, planar, outlier, factor, half, near
        )
        if fusion == LIKELIHOOD:
            weight, keep = 1.0, 1.0
            value -= q[0]
            e0, e1, e2 = q[1], q[2], q[3]
        else:
            # a streaming sum of exponentials: rescale what is there whenever the top rises
            keep = 1.0
            if q[0] > top:
                keep = math.exp(top - q[0])
                top = q[0]
            weight = math.exp(q[0] - top)
            total = total * keep + weight
            e0 = e1 = e2 = 0.0
        g0 = g0 * keep + weight * q[1]
        g1 = g1 * keep + weight * q[2]
        g2 = g2 * keep + weight * q[3]
        a00 = a00 * keep + weight * (q[4] - e0 * e0)
        a01 = a01 * keep + weight * (q[5] - e0 * e1)
        a11 = a11 * keep + weight * (q[6] - e1 * e1)
        a02 = a02 * keep + weight * (q[7] - e0 * e2)
        a12 = a12 * keep + weight * (q[8] - e1 * e2)
        a22 = a22 * keep + weight * (q[9] - e2 * e2)
    if fusion == SUMMING:
        value = -(top + math.log(total))
        r = 1.0 / total
        g0, g1, g2 = g0 * r, g1 * r, g2 * r
        a00, a01, a11 = a00 * r - g0 * g0, a01 * r - g0 * g1, a11 * r - g1 * g1
        a02, a12, a22 = a02 * r - g0 * g2, a12 * r - g1 * g2, a22 * r - g2 * g2
    if not planar:
        # t_y and phi do not exist: a unit curvature keeps the Newton step along them at zero
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
    """Solve (H + shift diag(scale)) step = -g by L D L'; False if it is not positive definite.

    Also returns d(|step|^2)/d(shift) / -2 in the scaled norm, for the search of the shift.
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
    # w = (H + shift D)^-1 D step, of which only step' D w is needed: ||L^-1 D step||^2 in D^-1
    z0 = scale[0] * s0
    z1 = scale[1] * s1 - l10 * z0
    z2 = scale[2] * s2 - l20 * z0 - l21 * z1
    return True, z0 * z0 / d0 + z1 * z1 / d1 + z2 * z2 / d2


@njit(error_model="numpy")
def _invert(h, inverse):
    """Inverse of a positive definite matrix, column by column; symmetric to the last bit."""
    unit, column = np.zeros(3), np.empty(3)
    for j in range(3):
        unit[j] = -1.0
        _shifted_solve(h, unit, 0.0, unit, column)
        unit[j] = 0.0
        for i in range(j, 3):
            inverse[i, j] = inverse[j, i] = column[i]


@njit(error_model="numpy")
def _decrease(h, g, step):
    """By how much the quadratic model -g' step - step' H step / 2 goes down."""
    total = 0.0
    for i in range(3):
        row = g[i]
        for j in range(3):
            row += 0.5 * h[i, j] * step[j]
        total -= step[i] * row
    return total


@njit(error_model="numpy")
def _reach_radius(h, g, shift, scale, radius, kick, step):
    """The hard case of an indefinite Hessian: the gradient misses its lowest eigenvector.

    Then the step ends within the radius however near the shift comes to that eigenvalue.  Going on
    along the eigenvector, which the nearly singular system magnifies out of any ``kick``, lowers
    the model further.
    """
    along = np.empty(3)
    definite, _ = _shifted_solve(h, g, 0.0, scale, along)
    norm = math.sqrt((scale * step * step).sum())
    if definite or norm >= 0.9 * radius:
        return
    solved, _ = _shifted_solve(h, kick * np.sqrt(scale), shift, scale, along)
    if not solved:
        return
    along /= math.sqrt((scale * along * along).sum())
    inner = (scale * along * step).sum()
    root = math.sqrt(inner * inner + radius * radius - norm * norm)
    forward, backward = step + (root - inner) * along, step - (root + inner) * along
    step[:] = forward if _decrease(h, g, forward) > _decrease(h, g, backward) else backward


@njit(error_model="numpy")
def _trust_region_step(h, g, scale, radius, kick, step):
    """Minimise the quadratic model within the radius (Moré & Sorensen 1983); its decrease.

    The shift of the Hessian is bracketed by Gershgorin's circles and found by Newton's method on
    1/|step|, to within a tenth of the radius, which is all that a trust region needs.
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
        norm = math.sqrt(
            scale[0] * step[0] * step[0]
            + scale[1] * step[1] * step[1]
            + scale[2] * step[2] * step[2]
        )
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
    _reach_radius(h, g, high, scale, radius, kick, step)
    return _decrease(h, g, step)


@njit(error_model="numpy")
def _first_radius(fixed, moving, d2d, planar, scale):
    """Three times the typical standard deviation of a pair: less than most basins of attraction.

    Fills the scale of the parameters: a rotation counts by the displacement it causes.
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
    peak,
    d2d,
    planar,
    fusion,
    outlier,
    factor,
    in_twist,
    tolerance,
    most,
    g,
    h,
):
    """Newton's method in a trust region, in place; (value, converged, iterations).

    A step is taken only if it lowers the cost, so the result is never worse than the start.
    Converged means: the Hessian is positive definite, and the Newton decrement g' H^-1 g, the
    squared distance to the optimum in estimated standard deviations, is below the tolerance, or
    the step can no longer lower the cost in floating point.
    """
    half, near = np.empty(fixed.shape[1]), np.empty(fixed.shape[1], dtype=np.uint64)
    step, scale, trial = np.empty(3), np.empty(3), np.empty(3)
    trial_g, trial_h = np.empty(3), np.empty((3, 3))
    kick = np.array(
        [1.0, 0.7 * planar, 0.4 * planar]
    )  # no direction that matters is at right angles
    radius = _first_radius(fixed, moving, d2d, planar, scale)
    value = _evaluate(
        theta, fixed, moving, peak, d2d, planar, fusion, outlier, factor, in_twist, half, near, g, h
    )
    for iteration in range(most):
        if not math.isfinite(value):
            return value, False, iteration
        definite, _ = _shifted_solve(h, g, 0.0, scale, step)
        decrement = -(g[0] * step[0] + g[1] * step[1] + g[2] * step[2]) if definite else np.inf
        if decrement <= tolerance:
            return value, True, iteration
        norm = math.sqrt(step[0] ** 2 + step[1] ** 2 + scale[2] * step[2] ** 2)
        if definite and norm <= radius:
            decrease = 0.5 * decrement
        else:
            decrease = _trust_region_step(h, g, scale, radius, kick, step)
            norm = math.sqrt(step[0] ** 2 + step[1] ** 2 + scale[2] * step[2] ** 2)
        for j in range(3):
            trial[j] = theta[j] + step[j]
        trial_value = _evaluate(
            trial,
            fixed,
            moving,
            peak,
            d2d,
            planar,
            fusion,
            outlier,
            factor,
            in_twist,
            half,
            near,
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
    return value, False, most


@njit(cache=True, nogil=True, error_model="numpy")
def evaluate_batch(
    thetas,
    fixed,
    moving,
    peaks,
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
    """Cost, gradient and Hessian of every problem; ``which`` (B, 3) names its sets and factor."""
    half, near = np.empty(fixed.shape[2]), np.empty(fixed.shape[2], dtype=np.uint64)
    for b in range(thetas.shape[0]):
        value[b] = _evaluate(
            thetas[b],
            fixed[which[b, 0]],
            moving[which[b, 1]],
            peaks[which[b, 0]],
            d2d,
            planar,
            fusion,
            outlier,
            factors[which[b, 2]],
            in_twist,
            half,
            near,
            gradient[b],
            hessian[b],
        )


@njit(cache=True, nogil=True, error_model="numpy")
def log_density_batch(
    thetas, fixed, moving, peaks, which, d2d, planar, outlier, factors, in_twist, log_density
):
    """log q_k of every target of every problem."""
    half, near = np.empty(fixed.shape[2]), np.empty(fixed.shape[2], dtype=np.uint64)
    for b in range(thetas.shape[0]):
        turn = (math.cos(thetas[b, 2]), math.sin(thetas[b, 2]))
        chart = _chart(thetas[b], in_twist)
        for k in range(moving.shape[2]):
            log_density[b, k] = _target(
                thetas[b],
                turn,
                chart,
                fixed[which[b, 0]],
                moving[which[b, 1]],
                k,
                math.log(peaks[which[b, 0]] * fixed.shape[2]),
                d2d,
                planar,
                outlier,
                factors[which[b, 2]],
                half,
                near,
            )[0]


@njit(cache=True, nogil=True, error_model="numpy")
def minimise_batch(
    thetas,
    fixed,
    moving,
    peaks,
    which,
    d2d,
    planar,
    fusion,
    outlier,
    factors,
    in_twist,
    tolerance,
    most,
    value,
    gradient,
    hessian,
    covariance,
    converged,
    iterations,
):
    """Minimise every problem of the batch, each on its own, from and into ``thetas``."""
    for b in range(thetas.shape[0]):
        value[b], converged[b], iterations[b] = _minimise(
            thetas[b],
            fixed[which[b, 0]],
            moving[which[b, 1]],
            peaks[which[b, 0]],
            d2d,
            planar,
            fusion,
            outlier,
            factors[which[b, 2]],
            in_twist,
            tolerance,
            most,
            gradient[b],
            hessian[b],
        )
        if converged[b]:
            _invert(hessian[b], covariance[b])
