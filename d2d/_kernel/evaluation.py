"""The cost of a motion, or of a velocity that several pairs of scans share, with derivatives.

Eight targets are evaluated at a time, one in each vector lane.  Everything stays in the log domain:
a target far from everything gives a large finite cost.
"""

import math

import numpy as np

from d2d._kernel.charts import (
    identity_chart,
    logarithm_chart,
    through_chart,
)
from d2d._kernel.compiling import inlined, merged
from d2d._kernel.densities import (
    fuse_likelihood,
    fuse_summing,
    measurement_terms,
    mix,
    multiply_measurements,
    set_uniform,
    sum_outliers,
)
from d2d._kernel.layout import (
    A00,
    A01,
    A02,
    A11,
    A12,
    A22,
    CORRUPTED,
    COUNTS,
    FACTOR,
    G0,
    G1,
    G2,
    KIND,
    LANES,
    LIKELIHOOD,
    LIMIT,
    LOG_2PI,
    LOG_INLIER_WEIGHT,
    LOG_OUTLIER_WEIGHT,
    NO_OUTLIER,
    OUTLIER,
    SUMMING,
    TOP,
    TOTAL,
    UNIFORM,
    Setting,
)
from d2d._kernel.pairs import lane_count, load_block, sum_inliers


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
        pair.gate,
        pair.log_peak,
        pair.log_spread,
    )


@inlined
def load_measurements(w, factors, order, chart, first):
    """Logarithms of the densities of the block's measurements, their gradients and Hessians."""
    last = order.shape[0] - 1
    xi = chart.x, chart.y, chart.phi
    for k in range(lane_count(w)):
        j = order[min(first + k, last)]
        terms = through_chart(measurement_terms(factors[j], xi), chart)
        for row in range(10):
            w[FACTOR + row * LANES + k] = terms[row]


@inlined
def limit_pairs(w, outlier, setting, measured):
    """Set each target's LIMIT: the half squared distance beyond which no pair matters.

    Beyond it all pairs together vanish beside the outlier component.
    """
    for k in range(LANES):
        w[LIMIT + k] = np.inf
        if outlier[KIND] != NO_OUTLIER:
            largest = outlier[LOG_INLIER_WEIGHT] + setting.log_peak - LOG_2PI
            w[LIMIT + k] = setting.gate + largest - w[OUTLIER + k]
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
        load_measurements(w, factors, order, setting.chart, first)
    if kind == CORRUPTED:
        sum_outliers(w, fixed, setting, outlier)
    elif kind == UNIFORM:
        set_uniform(w, outlier[LOG_OUTLIER_WEIGHT])
    limit_pairs(w, outlier, setting, measured)
    sum_inliers(w, fixed, setting)
    if measured:
        multiply_measurements(w)
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
