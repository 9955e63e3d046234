"""Which components account for a target, and by how much: the first of propagation's two passes.

With the names of ``pairs.py``.  The fixed set is copied into blocks of LANES components, one to a
vector lane, with rows as in ``layout.py``; each target is paired with all of them (the corrupted
Gaussian) or with those within its cut-off (the inlier density, see ``pairs.py``).
"""

import math
from typing import NamedTuple

import numpy as np

from d2d._kernel.compiling import compiled, inlined, merged, vectorised
from d2d._kernel.densities import VANISHING, measurement_terms
from d2d._kernel.elementary import exp, lowest_bit
from d2d._kernel.layout import (
    CHUNK,
    CORRUPTED,
    GAIN,
    INPUT_VARIANCE,
    KIND,
    LANES,
    LOG_2PI,
    LOG_OUTLIER_WEIGHT,
    PRECISION_XX,
    PRECISION_XY,
    PRECISION_YY,
    SLOPE,
    UNIFORM,
    VALUE,
    VARIANCE,
    WEIGHT,
    XX,
    XY,
    YY,
    X,
    Y,
)
from d2d._kernel.pairs import ABOVE, GATE, MAX_EXPONENT, NEAR, TINY

# A target's sums, lane by lane, in a separate array, because loops over the lanes would not
# vectorise without it: six moments of the outlier weights, and the bits of the components within
# the cut-off.
MOMENTS, WITHIN, SUMS = 0, 6 * LANES, 7 * LANES
# A block's rows: those of a packed set, the outlier weight, six cross derivatives.
OUTLIER_WEIGHT, CROSS = 6, 7
BLOCK = (CROSS + 6) * LANES


class Target(NamedTuple):
    """A target's mean and covariance, both rotated."""

    x: float
    y: float
    xx: float
    xy: float
    yy: float


class Term(NamedTuple):
    """The logarithm L of a pair's density: half d' B d, u = B d, L_phi, B and B v.

    ``v = E p - C_phi u``, with which the derivatives of -u and L_phi in the component's mean are
    B and B v; the derivative of L itself is u.
    """

    half: float
    root: float  # det(S)^(-1/2)
    ux: float
    uy: float
    turn: float
    bxx: float
    bxy: float
    byy: float
    vx: float
    vy: float


class Outliers(NamedTuple):
    """log of a target's outlier component, and means over its pairs, weighted by their densities.

    Without a corrupted Gaussian the means are zero.
    """

    log: float
    scale: float  # turns weights into shares
    ux: float
    uy: float
    uxx: float
    uxy: float
    uyy: float


class Factor(NamedTuple):
    """The logarithm of a measurement's density: its gradient, and what its two errors change."""

    log: float
    g0: float
    g1: float
    g2: float
    by_value: float  # the logarithm in the value
    v0: float  # the gradient in the value
    v1: float
    v2: float
    by_input: float  # the logarithm in the input, through the prediction
    i0: float
    i1: float
    i2: float


class Sums(NamedTuple):
    """A target's density, its gradient, and how the pairs' weights become shares of it."""

    log: float
    g0: float
    g1: float
    g2: float
    i0: float  # the gradient of the inlier component alone
    i1: float
    i2: float
    within: int  # number of components within the cut-off
    share: float  # of the inlier component
    scale: float  # from an inlier weight to its share
    outlier_scale: float


@inlined
def count_lanes(sums):
    """LANES as a value that is known only at run time, see `d2d._kernel.pairs.lane_count`."""
    return sums.shape[0] // (SUMS // LANES)


@merged
def load_components(w, fixed, setting):
    """Copy the components into blocks, means less the translation, cross derivatives of zero.

    A last block that is not full repeats its last component, without weight.
    """
    last = fixed.shape[1] - 1
    for i in range(w.shape[0] // BLOCK * LANES):
        at, j = (i // LANES) * BLOCK + i % LANES, min(i, last)
        w[at + X * LANES] = fixed[X, j] - setting.x
        w[at + Y * LANES] = fixed[Y, j] - setting.y
        w[at + XX * LANES] = fixed[XX, j]
        w[at + XY * LANES] = fixed[XY, j]
        w[at + YY * LANES] = fixed[YY, j]
        w[at + WEIGHT * LANES] = fixed[WEIGHT, j] if i <= last else 0.0
        for row in range(CROSS, CROSS + 6):
            w[at + row * LANES] = 0.0


@inlined
def load_target(moving, k, setting):
    """Rotate a target; the covariance is zero where the metric leaves it out."""
    cosine, sine = setting.cosine, setting.sine
    cc, cs, ss = cosine * cosine, cosine * sine, sine * sine
    x, y = moving[X, k], moving[Y, k]
    xx, xy = moving[XX, k] * setting.d2d, moving[XY, k] * setting.d2d
    yy = moving[YY, k] * (setting.d2d * setting.planar)
    return Target(
        cosine * x - sine * y,
        sine * x + cosine * y,
        cc * xx - 2.0 * cs * xy + ss * yy,
        cs * (xx - yy) + (cc - ss) * xy,
        ss * xx + 2.0 * cs * xy + cc * yy,
    )


@vectorised
def outlier_difference(block, lane, target, precision):
    """d, and half of d' B d, of a target and a component of a block."""
    bxx, bxy, byy = precision
    dx, dy = target.x - block[X * LANES + lane], target.y - block[Y * LANES + lane]
    return dx, dy, 0.5 * (bxx * dx * dx + 2.0 * bxy * dx * dy + byy * dy * dy)


@vectorised
def add_moments(w, sums, target, precision, offset):
    """Weigh all components by w_i exp(offset - d' B d / 2); sum the moments of d, lane by lane."""
    lanes = count_lanes(sums)
    for k in range(6 * LANES):
        sums[MOMENTS + k] = 0.0
    for at in range(0, w.shape[0], BLOCK):
        block = w[at : at + BLOCK]
        for k in range(lanes):
            dx, dy, half = outlier_difference(block, k, target, precision)
            v = block[WEIGHT * LANES + k] * exp(min(offset - half, MAX_EXPONENT))
            block[OUTLIER_WEIGHT * LANES + k] = v
            sums[MOMENTS + k] += v
            sums[MOMENTS + LANES + k] += v * dx
            sums[MOMENTS + 2 * LANES + k] += v * dy
            sums[MOMENTS + 3 * LANES + k] += v * dx * dx
            sums[MOMENTS + 4 * LANES + k] += v * dx * dy
            sums[MOMENTS + 5 * LANES + k] += v * dy * dy


@inlined
def moment(sums, number):
    """A moment, summed over the lanes."""
    added = 0.0
    for k in range(LANES):
        added += sums[MOMENTS + number * LANES + k]
    return added


@merged
def sum_outliers(w, sums, target, outlier):
    """The corrupted Gaussian's component; leaves the weight of every pair in its row."""
    precision = outlier[PRECISION_XX], outlier[PRECISION_XY], outlier[PRECISION_YY]
    bxx, bxy, byy = precision
    offset = 0.0
    add_moments(w, sums, target, precision, offset)
    if moment(sums, 0) < VANISHING:  # computed again, relative to the nearest component
        offset = np.inf
        for at in range(0, w.shape[0], BLOCK):
            for k in range(LANES):
                _, _, half = outlier_difference(w[at : at + BLOCK], k, target, precision)
                offset = min(offset, ABOVE * half)
        add_moments(w, sums, target, precision, offset)
    s = moment(sums, 0)
    r = 1.0 / s
    dx, dy = r * moment(sums, 1), r * moment(sums, 2)
    dxx, dxy, dyy = r * moment(sums, 3), r * moment(sums, 4), r * moment(sums, 5)
    return Outliers(
        outlier[LOG_OUTLIER_WEIGHT] - offset + math.log(s),
        r,
        bxx * dx + bxy * dy,
        bxy * dx + byy * dy,
        bxx * (bxx * dxx + bxy * dxy) + bxy * (bxx * dxy + bxy * dyy),
        bxx * (bxy * dxx + byy * dxy) + bxy * (bxy * dxy + byy * dyy),
        bxy * (bxy * dxx + byy * dxy) + byy * (bxy * dxy + byy * dyy),
    )


@merged
def outliers_of(w, sums, target, outlier):
    """The outlier component of any kind."""
    if outlier[KIND] == CORRUPTED:
        return sum_outliers(w, sums, target, outlier)
    log = outlier[LOG_OUTLIER_WEIGHT] if outlier[KIND] == UNIFORM else -np.inf
    return Outliers(log, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@vectorised
def difference(block, lane, target):
    """d and S of a target and a component of a block; d' adj(S) d and det(S), as in `pairs.py`."""
    dx, dy = target.x - block[X * LANES + lane], target.y - block[Y * LANES + lane]
    sxx = target.xx + block[XX * LANES + lane]
    sxy = target.xy + block[XY * LANES + lane]
    syy = target.yy + block[YY * LANES + lane]
    square = syy * dx * dx - 2.0 * sxy * dx * dy + sxx * dy * dy
    return dx, dy, sxx, sxy, syy, square, sxx * syy - sxy * sxy


@inlined
def inlier_term(w, at, target):
    """The pair of a target and a component, with the sum of both covariances."""
    dx, dy, sxx, sxy, syy, square, determinant = difference(w[at:], 0, target)
    inverse = 1.0 / determinant
    bxx, bxy, byy = syy * inverse, -sxy * inverse, sxx * inverse
    ux, uy = bxx * dx + bxy * dy, bxy * dx + byy * dy
    a, h = -2.0 * target.xy, target.xx - target.yy  # C_phi = [[a, h], [h, -a]]
    bent_x, bent_y = a * ux + h * uy, h * ux - a * uy
    turn = ux * (0.5 * bent_x + target.y) + uy * (0.5 * bent_y - target.x)
    turn -= 0.5 * (a * (bxx - byy) + 2.0 * h * bxy)
    vx, vy = -target.y - bent_x, target.x - bent_y
    return Term(
        0.5 * square * inverse,
        math.sqrt(inverse),
        ux,
        uy,
        turn,
        bxx,
        bxy,
        byy,
        bxx * vx + bxy * vy,
        bxy * vx + byy * vy,
    )


@vectorised
def mark_within(w, sums, target, cut_off, first, last):
    """Mark by bits, lane by lane, which components of some blocks lie within the cut-off."""
    lanes = count_lanes(sums)
    for k in range(lanes):
        sums[WITHIN + k] = 0.0
    bit = 1.0
    for number in range(first, last):
        at = number * BLOCK
        block = w[at : at + BLOCK]
        for k in range(lanes):
            _, _, _, _, _, square, determinant = difference(block, k, target)
            sums[WITHIN + k] += bit if square <= cut_off * determinant else 0.0
        bit *= 2.0


@compiled
def find_within(w, sums, target, cut_off, near):
    """Where the components within the cut-off stand in the blocks; their number.

    A component that only fills the last block is never among them.
    """
    found = 0
    blocks = w.shape[0] // BLOCK
    for first in range(0, blocks, CHUNK):
        last = min(first + CHUNK, blocks)
        mark_within(w, sums, target, cut_off, first, last)
        for k in range(LANES):
            bits = int(sums[WITHIN + k])
            while bits != 0:
                at = (first + lowest_bit(bits)) * BLOCK + k
                if w[at + WEIGHT * LANES] > 0.0:
                    near[found] = at
                    found += 1
                bits &= bits - 1
    return found


@merged
def find_nearest(w, target):
    """The smallest half squared Mahalanobis distance of a target."""
    nearest = np.inf
    for at in range(0, w.shape[0], BLOCK):
        for k in range(LANES):
            _, _, _, _, _, square, determinant = difference(w[at : at + BLOCK], k, target)
            nearest = min(nearest, 0.5 * square / determinant)
    return ABOVE * nearest


@compiled
def sum_inliers(w, target, offset, near, within, weights):
    """Weigh the components within the cut-off; the sum of the weights and its gradient."""
    s, s0, s1, s2 = TINY, 0.0, 0.0, 0.0
    for n in range(within):
        at = near[n]
        term = inlier_term(w, at, target)
        weight = w[at + WEIGHT * LANES] * term.root
        weight *= exp(min(offset - term.half, MAX_EXPONENT))
        weights[n] = weight
        s += weight
        s0 -= weight * term.ux
        s1 -= weight * term.uy
        s2 += weight * term.turn
    return s, s0, s1, s2


@inlined
def to_motion(g0, g1, g2, chart):
    """A gradient in a chart's image becomes that in the chart's coordinates."""
    return (
        chart.a * g0 - chart.b * g1,
        chart.b * g0 + chart.a * g1,
        chart.c * g0 + chart.d * g1 + g2,
    )


@merged
def factor_of(factors, k, chart):
    """A target's measurement at the motion of a chart; one of density 1 if there is none."""
    if factors.shape[0] == 0:
        return Factor(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    factor = factors[k]
    h0, h1, h2 = factor[GAIN], factor[GAIN + 1], factor[GAIN + 2]
    s0, s1, s2 = factor[SLOPE], factor[SLOPE + 1], factor[SLOPE + 2]
    terms = measurement_terms(factor, (chart.x, chart.y, chart.phi))
    residual = factor[VALUE] - h0 * chart.x - h1 * chart.y - h2 * chart.phi
    slope = s0 * chart.x + s1 * chart.y + s2 * chart.phi
    variance = factor[VARIANCE] + factor[INPUT_VARIANCE] * slope * slope
    e = residual / variance
    along = 2.0 * factor[INPUT_VARIANCE] * slope * e / variance
    v0, v1, v2 = h0 / variance + along * s0, h1 / variance + along * s1, h2 / variance + along * s2
    g0, g1, g2 = to_motion(terms[1], terms[2], terms[3], chart)
    i0, i1, i2 = to_motion(e * s0 - slope * v0, e * s1 - slope * v1, e * s2 - slope * v2, chart)
    v0, v1, v2 = to_motion(v0, v1, v2, chart)
    return Factor(terms[0], g0, g1, g2, -e, v0, v1, v2, slope * e, i0, i1, i2)


@merged
def weigh(w, sums, target, factor, outliers, log_inlier_weight, setting, pairs):
    """Weigh a target's pairs; its density, with gradient, and the inlier component's share.

    The cut-off is that of `d2d._kernel.pairs.sum_inliers`.
    """
    near, weights = pairs
    limit = setting.gate + log_inlier_weight + setting.log_peak - LOG_2PI + factor.log
    limit -= outliers.log
    enough = NEAR + setting.gate + setting.log_spread
    smallest = math.exp(setting.log_peak - NEAR - setting.log_spread)
    offset = 0.0
    within = find_within(w, sums, target, 2.0 * min(limit, enough), near)
    s, s0, s1, s2 = sum_inliers(w, target, offset, near, within, weights)
    if s < smallest and limit > enough:  # none is near: relative to the nearest component
        offset = find_nearest(w, target)
        cut_off = 2.0 * min(limit, offset + setting.gate + setting.log_spread)
        within = find_within(w, sums, target, cut_off, near)
        s, s0, s1, s2 = sum_inliers(w, target, offset, near, within, weights)
    inlier = log_inlier_weight + factor.log + math.log(s) - offset - LOG_2PI
    gap = outliers.log - inlier
    ratio = math.exp(-abs(gap)) if abs(gap) <= GATE else 0.0  # of the smaller over the larger
    larger = 1.0 / (1.0 + ratio)
    share = ratio * larger if gap > 0.0 else larger
    rest = 1.0 - share
    g0, g1, g2 = factor.g0 + s0 / s, factor.g1 + s1 / s, factor.g2 + s2 / s
    turn = target.y * outliers.ux - target.x * outliers.uy
    return Sums(
        max(inlier, outliers.log) + math.log(1.0 + ratio),
        share * g0 - rest * outliers.ux,
        share * g1 - rest * outliers.uy,
        share * g2 + rest * turn,
        g0,
        g1,
        g2,
        within,
        share,
        share / s,
        rest * outliers.scale,
    )
