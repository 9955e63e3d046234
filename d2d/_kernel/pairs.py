"""The double sum over targets and components: the inlier density and its derivatives.

Per pair of a moving target ``k`` and a component ``i``, with the rotated mean ``p = R mu_k`` and
the rotated covariance ``C = R Sigma_k R'``::

    d = p + t - mu_i      S = C + Sigma_i      B = S^-1      u = B d      N = N(0 | d, S)

The derivatives of ``N`` along the rotation follow from those along ``d``, as ``S`` turns with it
and ``dN/dS = N_dd / 2``.

Each target is paired only with the components within its cut-off.  A component is left out if it is
certainly below ``exp(-GATE)`` of the target's sum: ``det(A + B)^(1/2) >= det(A)^(1/2) +
det(B)^(1/2)`` (Minkowski) bounds the normalisation of every pair by that of the component alone,
``w_i det(Sigma_i)^(-1/2)``, for any rotation.  All pairs of a target that are left out together
change its density by less than ``exp(-GATE)`` = 2e-16 of it.
"""

import math

from d2d._kernel.compile import compiled, inlined, vectorised
from d2d._kernel.elementary import exp, log, lowest_bit
from d2d._kernel.layout import (
    A00,
    A01,
    A02,
    A11,
    A12,
    A22,
    CHUNK,
    COUNTS,
    CUT_OFF,
    CXX,
    CXY,
    CYY,
    DETERMINANT,
    G0,
    G1,
    G2,
    GATE,
    INLIER,
    LANES,
    LIMIT,
    LOG_2PI,
    MX,
    MY,
    OFFSET,
    SQUARE,
    STEP,
    STEPS,
    TO_SHARE,
    WEIGHT,
    WITHIN,
    XX,
    XY,
    YY,
    X,
    Y,
    lane_count,
)

NEAR = 12.5  # half a squared distance of five standard deviations
# A sum that is computed relative to its nearest component must not lose that component to rounding,
# however far away it is.  So all passes compute the distance by one formula, the offset is a little
# larger than it, and exponents above MAX_EXPONENT are cut off.
ABOVE, MAX_EXPONENT = 1.0 + 1e-14, 200.0
FAR = 1000.0  # times its own size away, a set is registered about its mean
TINY = 1e-300  # where each sum begins, so that the logarithm of an empty one is finite


@vectorised
def load_block(w, moving, order, setting, first):
    """Rotate the block's means and covariances; an incomplete block repeats its last target."""
    cosine, sine, d2d = setting.cosine, setting.sine, setting.d2d
    lanes = lane_count(w)
    cc, cs, ss = cosine * cosine, cosine * sine, sine * sine
    last = order.shape[0] - 1
    for k in range(lanes):
        j = order[min(first + k, last)]
        x, y = moving[X, j], moving[Y, j]
        w[MX + k] = cosine * x - sine * y
        w[MY + k] = sine * x + cosine * y
        w[COUNTS + k] = 1.0 if first + k <= last else 0.0
        sxx, sxy = moving[XX, j] * d2d, moving[XY, j] * d2d
        syy = moving[YY, j] * (d2d * setting.planar)
        w[CXX + k] = cc * sxx - 2.0 * cs * sxy + ss * syy
        w[CXY + k] = cs * (sxx - syy) + (cc - ss) * sxy
        w[CYY + k] = ss * sxx + 2.0 * cs * sxy + cc * syy


@vectorised
def component_of(fixed, i, setting):
    """Mean, less the translation, and covariance of a component."""
    return (
        fixed[X, i] - setting.x,
        fixed[Y, i] - setting.y,
        fixed[XX, i],
        fixed[XY, i],
        fixed[YY, i],
    )


@vectorised
def difference(w, k, component):
    """d and S of a target and a component; d' adj(S) d and det(S), whose ratio is d' S^-1 d."""
    fx, fy, fxx, fxy, fyy = component
    dx, dy = w[MX + k] - fx, w[MY + k] - fy
    sxx, sxy, syy = w[CXX + k] + fxx, w[CXY + k] + fxy, w[CYY + k] + fyy
    square = syy * dx * dx - 2.0 * sxy * dx * dy + sxx * dy * dy
    return dx, dy, sxx, sxy, syy, square, sxx * syy - sxy * sxy


@vectorised
def find_nearest(w, fixed, setting):
    """The smallest half squared Mahalanobis distance of each target, as its OFFSET.

    Distances d' adj(S) d / det(S) are compared by cross-multiplication, without a division.
    """
    lanes = lane_count(w)
    for k in range(LANES):
        w[SQUARE + k], w[DETERMINANT + k] = 1.0, 0.0
    for i in range(fixed.shape[1]):
        component = component_of(fixed, i, setting)
        for k in range(lanes):
            _, _, _, _, _, square, determinant = difference(w, k, component)
            old_square, old_determinant = w[SQUARE + k], w[DETERMINANT + k]
            nearer = square * old_determinant < old_square * determinant
            w[SQUARE + k] = square if nearer else old_square
            w[DETERMINANT + k] = determinant if nearer else old_determinant
    for k in range(lanes):
        w[OFFSET + k] = 0.5 * w[SQUARE + k] / w[DETERMINANT + k]
        w[OFFSET + k] *= ABOVE


@vectorised
def find_within(w, fixed, setting, first, last):
    """Mark by bits which components lie within each target's cut-off; return the largest number.

    Looks at the components from ``first`` to ``last``.
    """
    lanes = lane_count(w)
    for k in range(lanes):
        w[WITHIN + k] = 0.0
    bit = 1.0
    for i in range(first, last):
        component = component_of(fixed, i, setting)
        for k in range(lanes):
            _, _, _, _, _, square, determinant = difference(w, k, component)
            within = square <= w[CUT_OFF + k] * determinant
            w[WITHIN + k] += bit if within else 0.0
        bit *= 2.0
    largest = 0
    for k in range(LANES):
        bits, number = int(w[WITHIN + k]), 0
        while bits != 0:
            bits &= bits - 1  # without the lowest one
            number += 1
        largest = max(largest, number)
    return largest


@inlined
def gather_within(w, fixed, setting, first, steps):
    """Copy each target's next component within its cut-off into the rows of each step.

    A target that has no more of them gets one at its own place, with zero weight.
    """
    last = fixed.shape[1] - 1
    for k in range(LANES):
        bits = int(w[WITHIN + k])
        for at in range(STEPS + k, STEPS + k + steps * STEP, STEP):
            more = bits != 0
            i = first + lowest_bit(bits) if more else last
            w[at + X * LANES] = fixed[X, i] - setting.x if more else w[MX + k]
            w[at + Y * LANES] = fixed[Y, i] - setting.y if more else w[MY + k]
            w[at + XX * LANES] = fixed[XX, i]
            w[at + XY * LANES] = fixed[XY, i]
            w[at + YY * LANES] = fixed[YY, i]
            w[at + WEIGHT * LANES] = fixed[WEIGHT, i] if more else 0.0
            bits &= bits - 1


@vectorised
def add_step(w, step):
    """Add one pair of each target: w_i N(0 | d_i, S_i) exp(OFFSET) and its derivatives.

    By the heat equation, dN/dS = N_dd / 2 (Price 1958), all derivatives follow from those along d,
    which are polynomials in u = B d times N.  The rotation turns S by C_phi = 2 M with
    M = [[-a, h], [h, a]], and so N by the operator K = M : d^2; summed are 1, d, d^2, K d and K^2::

        K N = (u'Mu - tr(MB)) N         K N_d = (2 BMu - u K) N
        K^2 N = (K^2 - 4 u'MBMu + 2 tr(MBMB)) N,  tr(MBMB) = tr(MB)^2 - 2 det(M) det(B)
    """
    lanes = lane_count(w)
    for k in range(lanes):
        component = (
            step[X * LANES + k],
            step[Y * LANES + k],
            step[XX * LANES + k],
            step[XY * LANES + k],
            step[YY * LANES + k],
        )
        dx, dy, sxx, sxy, syy, square, determinant = difference(w, k, component)
        a, h = w[CXY + k], 0.5 * (w[CXX + k] - w[CYY + k])
        inverse = 1.0 / determinant
        half = 0.5 * square * inverse
        bxx, bxy, byy = syy * inverse, -sxy * inverse, sxx * inverse
        ux, uy = bxx * dx + bxy * dy, bxy * dx + byy * dy
        weight = step[WEIGHT * LANES + k] * math.sqrt(inverse)
        weight *= exp(min(w[OFFSET + k] - half, MAX_EXPONENT))
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


@vectorised
def add_pairs(w, fixed, setting):
    """Sum over the components within the cut-off, see `add_step`."""
    for k in range(10 * LANES):
        w[INLIER + k] = 0.0
    for k in range(LANES):
        w[INLIER + k] = TINY
    for first in range(0, fixed.shape[1], CHUNK):
        last = min(first + CHUNK, fixed.shape[1])
        steps = find_within(w, fixed, setting, first, last)
        gather_within(w, fixed, setting, first, steps)
        for at in range(STEPS, STEPS + steps * STEP, STEP):
            add_step(w, w[at : at + STEP])


@vectorised
def sum_inliers(w, fixed, setting):
    """log sum_i w_i N(0 | d_i, S_i), its relative gradient and second derivatives.

    ``LIMIT`` is the half squared distance up to which pairs could matter to each target beside its
    outlier component, ``CUT_OFF`` the squared distance up to which components are paired.
    """
    lanes = lane_count(w)
    # Nearly always some component is so near that all beyond this distance vanish beside it.
    enough = NEAR + GATE + setting.log_spread
    for k in range(lanes):
        w[CUT_OFF + k] = 2.0 * min(w[LIMIT + k], enough)
        w[OFFSET + k] = 0.0
    smallest = math.exp(setting.log_peak - NEAR - setting.log_spread)
    for again in range(2):
        add_pairs(w, fixed, setting)
        incomplete = False
        for k in range(lanes):
            incomplete |= (w[INLIER + k] < smallest) & (w[LIMIT + k] > enough)
        if again or not incomplete:
            break
        # Where none is near, the cut-off is measured from the nearest component.
        find_nearest(w, fixed, setting)
        for k in range(lanes):
            w[CUT_OFF + k] = 2.0 * min(w[LIMIT + k], w[OFFSET + k] + GATE + setting.log_spread)
    finish_inliers(w)


@vectorised
def finish_inliers(w):
    """From the sums of 1, d, d^2, K d and K^2 to the logarithm and its derivatives.

    d/dphi = d_phi . d + K with d_phi = (-y, x), d_phiphi = -(x, y) and
    M_phi = 2 [[-h, -a], [-a, h]].
    """
    lanes = lane_count(w)
    for k in range(lanes):
        x, y, a, h = w[MX + k], w[MY + k], w[CXY + k], 0.5 * (w[CXX + k] - w[CYY + k])
        r = w[TO_SHARE + k] = 1.0 / w[INLIER + k]
        g0, g1 = r * w[INLIER + G0 + k], r * w[INLIER + G1 + k]
        a00, a01, a11 = r * w[INLIER + A00 + k], r * w[INLIER + A01 + k], r * w[INLIER + A11 + k]
        k0, k1 = r * w[INLIER + A02 + k], r * w[INLIER + A12 + k]
        w[INLIER + k] = log(w[INLIER + k]) - w[OFFSET + k] - LOG_2PI
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


@compiled
def bounds(fixed, moving, extremes):
    """Logarithms of the largest possible sum over the pairs, and of its ratio to the smallest pair.

    ``extremes`` holds the largest w_i det(Sigma_i)^(-1/2), the smallest w_i and the largest trace
    of the fixed set; det(S)^(1/2) <= tr(S) / 2.
    """
    trace = 0.0
    for k in range(moving.shape[1]):
        trace = max(trace, moving[XX, k] + moving[YY, k])
    peak = extremes[0] * fixed.shape[1]
    return math.log(peak), math.log(0.5 * peak * (extremes[2] + trace) / extremes[1])


@compiled
def find_extremes(points, extremes):
    """The largest w_i det(Sigma_i)^(-1/2), smallest w_i and largest tr(Sigma_i) of a set."""
    peak, weight, trace = 0.0, math.inf, 0.0
    for i in range(points.shape[1]):
        xx, xy, yy = points[XX, i], points[XY, i], points[YY, i]
        peak = max(peak, points[WEIGHT, i] / math.sqrt(xx * yy - xy * xy))
        weight = min(weight, points[WEIGHT, i])
        trace = max(trace, xx + yy)
    extremes[0], extremes[1], extremes[2] = peak, weight, trace


@compiled
def is_far(points, planar):
    """Whether a set's mean is more than FAR times its own size away from the origin.

    The size is the root mean square distance of its targets from their mean, errors included.
    """
    x, y, square, count = 0.0, 0.0, 0.0, points.shape[1]
    for i in range(count):
        x += points[X, i] / count
        y += points[Y, i] / count
    for i in range(count):
        dx, dy = points[X, i] - x, points[Y, i] - y
        square += (dx * dx + dy * dy + points[XX, i] + planar * points[YY, i]) / count
    return x * x + y * y > FAR * FAR * square
