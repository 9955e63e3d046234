"""The cost of a motion, or of a velocity that several pairs of scans share, with derivatives.

Eight targets are evaluated at a time, one in each vector lane.  Everything stays in the log domain:
a target far from everything gives a large finite cost.
"""

import math

import numpy as np

from d2d._kernel.charts import exponential_chart, identity_chart, logarithm_chart
from d2d._kernel.compile import compiled, inlined, merged
from d2d._kernel.densities import measurement_jets, outlier_jet
from d2d._kernel.jets import fuse_likelihood, fuse_summing, mix, multiply, through_chart
from d2d._kernel.layout import (
    A00,
    A01,
    A02,
    A11,
    A12,
    A22,
    ARC,
    COUNTS,
    FACTOR,
    FACTOR_START,
    FIXED_SET,
    FIXED_SIZE,
    FIXED_START,
    G0,
    G1,
    G2,
    GATE,
    KIND,
    LANES,
    LIKELIHOOD,
    LIMIT,
    LOG_2PI,
    LOG_INLIER_WEIGHT,
    MOVING_SIZE,
    MOVING_START,
    NO_OUTLIER,
    OUTLIER,
    SHARES,
    SUMMING,
    TOP,
    TOTAL,
    Pair,
    Setting,
)
from d2d._kernel.pairs import bounds, load_block, sum_inliers


@inlined
def setting_of(pair, theta):
    """A motion with the numbers of a pair."""
    return Setting(
        theta[0],
        theta[1],
        math.cos(theta[2]),
        math.sin(theta[2]),
        logarithm_chart(theta) if pair.in_twist else identity_chart(theta),
        pair.d2d,
        pair.planar,
        pair.log_peak,
        pair.log_spread,
    )


@inlined
def limit_pairs(w, outlier, setting, measured):
    """Set each target's LIMIT: the half squared distance beyond which no pair matters.

    Beyond it all pairs together vanish beside the outlier component.
    """
    for k in range(LANES):
        w[LIMIT + k] = np.inf
        if outlier[KIND] != NO_OUTLIER:
            largest = outlier[LOG_INLIER_WEIGHT] + setting.log_peak - LOG_2PI
            w[LIMIT + k] = GATE + largest - w[OUTLIER + k]
            if measured:
                w[LIMIT + k] += w[FACTOR + k]
        if w[COUNTS + k] == 0.0:
            w[LIMIT + k] = -1.0


@merged
def evaluate_block(w, fixed, moving, order, factors, outlier, setting, first):
    """log q_k, its gradient and q_k's second derivatives over q_k, of a block of targets.

    They are left in the rows of INLIER.
    """
    kind, measured = outlier[KIND], factors.shape[0] > 0
    load_block(w, moving, order, setting, first)
    if measured:
        measurement_jets(w, factors, order, setting.chart, first)
    outlier_jet(w, fixed, setting, outlier)
    limit_pairs(w, outlier, setting, measured)
    sum_inliers(w, fixed, setting)
    if measured:
        multiply(w)
    if kind != NO_OUTLIER:
        mix(w, outlier[LOG_INLIER_WEIGHT])


@inlined
def total(w, row):
    """Sum of a row of totals over the lanes."""
    added = 0.0
    for k in range(LANES):
        added += w[TOTAL + row + k]
    return added


@inlined
def align_tops(w):
    """Make the totals of all lanes relative to the largest density; return its logarithm."""
    top = -np.inf
    for k in range(LANES):
        top = max(top, w[TOP + k])
    for k in range(LANES):
        keep = math.exp(w[TOP + k] - top)
        for row in range(0, 10 * LANES, LANES):
            w[TOTAL + row + k] *= keep
    return top


@merged
def evaluate_pair(pair, theta, fusion, w, g, h):
    """Cost of one pair of sets at the motion theta; gradient to g (3), Hessian to h (3, 3)."""
    setting = setting_of(pair, theta)
    fixed, moving, order = pair.fixed, pair.moving, pair.order
    factors, outlier = pair.factors, pair.outlier
    for k in range(10 * LANES):
        w[TOTAL + k] = 0.0
    for k in range(LANES):
        w[TOP + k] = -np.inf
    for first in range(0, moving.shape[1], LANES):
        evaluate_block(w, fixed, moving, order, factors, outlier, setting, first)
        if fusion == LIKELIHOOD:
            fuse_likelihood(w)
        else:
            fuse_summing(w)
    top = align_tops(w) if fusion == SUMMING else 0.0
    value = -total(w, 0)
    g0, g1, g2 = total(w, G0), total(w, G1), total(w, G2)
    a00, a01, a11 = total(w, A00), total(w, A01), total(w, A11)
    a02, a12, a22 = total(w, A02), total(w, A12), total(w, A22)
    if fusion == SUMMING:
        r = -1.0 / value
        value = -(top + math.log(-value))
        g0, g1, g2 = g0 * r, g1 * r, g2 * r
        a00, a01, a11 = a00 * r - g0 * g0, a01 * r - g0 * g1, a11 * r - g1 * g1
        a02, a12, a22 = a02 * r - g0 * g2, a12 * r - g1 * g2, a22 * r - g2 * g2
    if not pair.planar:
        # on a line there is no t_y and phi: unit curvature keeps the Newton step along them at zero
        g1 = g2 = a01 = a02 = a12 = 0.0
        a11 = a22 = -1.0
    g[0], g[1], g[2] = -g0, -g1, -g2
    h[0, 0], h[1, 1], h[2, 2] = -a00, -a11, -a22
    h[0, 1] = h[1, 0] = -a01
    h[0, 2] = h[2, 0] = -a02
    h[1, 2] = h[2, 1] = -a12
    return value


@compiled
def pair_at(batch, number):
    """One pair of the batch, bound."""
    row = batch.pairs[number]
    start, stop = row[MOVING_START], row[MOVING_START] + row[MOVING_SIZE]
    fixed = batch.fixed[:, row[FIXED_START] : row[FIXED_START] + row[FIXED_SIZE]]
    moving = batch.moving[:, start:stop]
    at, measured = row[FACTOR_START], row[MOVING_SIZE] if row[FACTOR_START] >= 0 else 0
    factors = batch.factors[at : at + measured]
    log_peak, log_spread = bounds(fixed, moving, batch.extremes[row[FIXED_SET]])
    return Pair(
        fixed,
        moving,
        batch.orders[start:stop],
        factors,
        batch.outlier,
        batch.d2d,
        batch.planar,
        batch.in_twist,
        log_peak,
        log_spread,
    )


@inlined
def motion_chart(batch, number, theta):
    """The motion of a pair at theta; if theta is a velocity, the exponential of its twist."""
    interval = batch.intervals[number]
    x, y, w = interval * theta[0], interval * theta[1], interval * theta[2]
    if batch.kind == ARC:
        return exponential_chart(x, y, w)
    return identity_chart((x, y, w))


@inlined
def add_derivatives(work, chart, interval, g, h):
    """Add a pair's derivatives in theta, from those in its motion, which are in ``work``."""
    pg, ph = work.gradient, work.hessian
    terms = (0.0, pg[0], pg[1], pg[2], ph[0, 0], ph[0, 1], ph[1, 1], ph[0, 2], ph[1, 2], ph[2, 2])
    _, g0, g1, g2, h00, h01, h11, h02, h12, h22 = through_chart(terms, chart)
    square = interval * interval
    g[0] += interval * g0
    g[1] += interval * g1
    g[2] += interval * g2
    h[0, 0] += square * h00
    h[1, 1] += square * h11
    h[2, 2] += square * h22
    h[0, 1] += square * h01
    h[0, 2] += square * h02
    h[1, 2] += square * h12
    h[1, 0], h[2, 0], h[2, 1] = h[0, 1], h[0, 2], h[1, 2]


@merged
def evaluate(batch, problem, pair, theta, work, g, h):
    """Cost of a problem at theta, and the sum of its targets' inlier shares.

    The cost is the sum over the problem's pairs, of which ``pair`` is the first, and the prior's;
    its gradient goes to g (3), its Hessian to h (3, 3).
    """
    w, motion = work.scratch, work.motion
    for k in range(LANES):
        w[SHARES + k] = 0.0
    for j in range(3):
        g[j] = h[0, j] = h[1, j] = h[2, j] = 0.0
    value, shares = 0.0, 0.0
    first = batch.first[problem]
    for number in range(first, batch.first[problem + 1]):
        if number > first:
            pair = pair_at(batch, number)
        chart = motion_chart(batch, number, theta)
        motion[0], motion[1], motion[2] = chart.x, chart.y, chart.phi
        value += evaluate_pair(pair, motion, batch.fusion, w, work.gradient, work.hessian)
        add_derivatives(work, chart, batch.intervals[number], g, h)
    for j in range(3):
        weighted = batch.prior[j] * theta[j]
        value += 0.5 * weighted * theta[j]
        g[j] += weighted
        h[j, j] += batch.prior[j]
    for k in range(LANES):
        shares += w[SHARES + k]
    return value, shares
