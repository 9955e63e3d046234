"""How the gradient changes with every measured coordinate: what propagation of errors needs.

Every cost has the gradient ``f_theta = -sum_ki gamma_ki L_theta,ki`` with responsibilities gamma
that sum to one over a target's components (likelihood) or over all pairs (summing), and with the
mean gradient g over the same pairs::

    f_theta,z = -sum_ki gamma_ki (L_theta,z + (L_theta - g) L_z')

`d2d.dense.cross_derivatives` has it in NumPy.  Two passes go over the pairs of each target: the
first finds gamma and g (``responsibilities.py``), the second adds up.  No pair is stored.
"""

import math

import numpy as np
from numpy.typing import NDArray

from d2d._kernel.compiling import compiled, entry, inlined, merged, vectorised
from d2d._kernel.evaluation import setting_of
from d2d._kernel.layout import (
    CORRUPTED,
    KIND,
    LANES,
    LOG_INLIER_WEIGHT,
    PRECISION_XX,
    PRECISION_XY,
    PRECISION_YY,
    SUMMING,
)
from d2d._kernel.minimisation import motion_chart, pair_at
from d2d._kernel.responsibilities import (
    BLOCK,
    CROSS,
    OUTLIER_WEIGHT,
    SUMS,
    count_lanes,
    factor_of,
    inlier_term,
    load_components,
    load_target,
    outlier_difference,
    outliers_of,
    to_motion,
    weigh,
)
from d2d._types import Array


def make_propagation_work(size: int) -> tuple[Array, Array, NDArray[np.int64], Array]:
    """Memory for fixed sets of up to that size."""
    blocks = -(-size // LANES)
    return (
        np.empty(blocks * BLOCK),
        np.empty(SUMS),
        np.empty(blocks * LANES, dtype=np.int64),
        np.empty(blocks * LANES),
    )


@merged
def add_inliers(w, target, factor, scale, mean, near, weights, moved):
    """Add a target's pairs within its cut-off to the cross derivatives of both of their means.

    ``near`` says where their components stand in the blocks.
    """
    m0, m1, m2 = mean
    for n in range(near.shape[0]):
        at = near[n]
        term = inlier_term(w, at, target)
        gamma = scale * weights[n]
        c0 = factor.g0 - term.ux - m0
        c1 = factor.g1 - term.uy - m1
        c2 = factor.g2 + term.turn - m2
        x0, y0 = gamma * (term.bxx + c0 * term.ux), gamma * (term.bxy + c0 * term.uy)
        x1, y1 = gamma * (term.bxy + c1 * term.ux), gamma * (term.byy + c1 * term.uy)
        x2, y2 = gamma * (term.vx + c2 * term.ux), gamma * (term.vy + c2 * term.uy)
        own = at + CROSS * LANES
        w[own] -= x0
        w[own + LANES] -= y0
        w[own + 2 * LANES] -= x1
        w[own + 3 * LANES] -= y1
        w[own + 4 * LANES] -= x2
        w[own + 5 * LANES] -= y2
        moved[0, 0] += x0
        moved[0, 1] += y0
        moved[1, 0] += x1
        moved[1, 1] += y1
        moved[2, 0] += x2 + gamma * term.uy  # d_phi = E p depends on the target's position
        moved[2, 1] += y2 - gamma * term.ux


@vectorised
def add_outliers_fixed(w, sums, target, precision, scale, mean):
    """Add a target's pairs in the corrupted Gaussian to those of the fixed means."""
    lanes = count_lanes(sums)
    bxx, bxy, byy = precision
    x, y = target.x, target.y
    vx, vy = bxy * x - bxx * y, byy * x - bxy * y
    m0, m1, m2 = mean
    for at in range(0, w.shape[0], BLOCK):
        block = w[at : at + BLOCK]
        for k in range(lanes):
            dx, dy, _ = outlier_difference(block, k, target, precision)
            gamma = scale * block[OUTLIER_WEIGHT * LANES + k]
            ux, uy = bxx * dx + bxy * dy, bxy * dx + byy * dy
            c0, c1, c2 = -ux - m0, -uy - m1, y * ux - x * uy - m2
            own = CROSS * LANES + k
            block[own] -= gamma * (bxx + c0 * ux)
            block[own + LANES] -= gamma * (bxy + c0 * uy)
            block[own + 2 * LANES] -= gamma * (bxy + c1 * ux)
            block[own + 3 * LANES] -= gamma * (byy + c1 * uy)
            block[own + 4 * LANES] -= gamma * (vx + c2 * ux)
            block[own + 5 * LANES] -= gamma * (vy + c2 * uy)


@inlined
def add_outliers_moving(target, outliers, precision, share, mean, moved):
    """Add the same pairs to the derivatives in the moving mean: moments are enough."""
    bxx, bxy, byy = precision
    x, y, ux, uy = target.x, target.y, outliers.ux, outliers.uy
    uxx, uxy, uyy = outliers.uxx, outliers.uxy, outliers.uyy
    m0, m1, m2 = mean
    moved[0, 0] += share * (bxx - uxx - m0 * ux)
    moved[0, 1] += share * (bxy - uxy - m0 * uy)
    moved[1, 0] += share * (bxy - uxy - m1 * ux)
    moved[1, 1] += share * (byy - uyy - m1 * uy)
    moved[2, 0] += share * (bxy * x - bxx * y + y * uxx - x * uxy - m2 * ux + uy)
    moved[2, 1] += share * (byy * x - bxy * y + y * uxy - x * uyy - m2 * uy - ux)


@inlined
def write_measured(factor, share, centred, by_value, by_input):
    """A target's cross derivatives in its measured value and in the input of its prediction.

    ``centred`` is the sum of gamma (L_theta - g) over the target's inlier pairs, ``share``
    the sum of their gamma.
    """
    d0, d1, d2 = centred
    by_value[0] = -share * factor.v0 - d0 * factor.by_value
    by_value[1] = -share * factor.v1 - d1 * factor.by_value
    by_value[2] = -share * factor.v2 - d2 * factor.by_value
    by_input[0] = -share * factor.i0 - d0 * factor.by_input
    by_input[1] = -share * factor.i1 - d1 * factor.by_input
    by_input[2] = -share * factor.i2 - d2 * factor.by_input


@merged
def rotate_back(moved, setting):
    """Derivatives in a rotated mean become those in the mean itself: G R."""
    cosine, sine = setting.cosine, setting.sine
    for i in range(3):
        x, y = moved[i, 0], moved[i, 1]
        moved[i, 0], moved[i, 1] = cosine * x + sine * y, cosine * y - sine * x


@compiled
def scale_rows(rows, chart, interval):
    """Derivatives of the gradient in a motion become those of the gradient in its velocity."""
    g0, g1, g2 = to_motion(rows[0], rows[1], rows[2], chart)
    rows[0], rows[1], rows[2] = interval * g0, interval * g1, interval * g2


@merged
def cross_pair(pair, setting, fusion, work, by_fixed, by_moving, by_value, by_input):
    """Cross derivatives of one pair of sets, of the gradient in the motion.

    With the sum, all targets share one density and one mean gradient; a separate pass finds them.
    """
    w, sums, near, weights = work
    fixed, moving, factors, outlier = pair.fixed, pair.moving, pair.factors, pair.outlier
    precision = outlier[PRECISION_XX], outlier[PRECISION_XY], outlier[PRECISION_YY]
    log_weight = outlier[LOG_INLIER_WEIGHT]
    w = w[: (fixed.shape[1] + LANES - 1) // LANES * BLOCK]
    load_components(w, fixed, setting)
    top, total, m0, m1, m2 = -np.inf, 0.0, 0.0, 0.0, 0.0
    targets = moving.shape[1]
    rounds = 2 if fusion == SUMMING else 1
    for visit in range(rounds * targets):
        k = visit % targets
        target, factor = load_target(moving, k, setting), factor_of(factors, k, setting.chart)
        outliers = outliers_of(w, sums, target, outlier)
        found = weigh(w, sums, target, factor, outliers, log_weight, setting, (near, weights))
        if visit < (rounds - 1) * targets:
            keep = math.exp(min(top - found.log, 0.0))
            own = math.exp(min(found.log - top, 0.0))
            top = max(top, found.log)
            total = keep * total + own
            m0 = keep * m0 + own * found.g0
            m1 = keep * m1 + own * found.g1
            m2 = keep * m2 + own * found.g2
            continue
        weight = 1.0
        if fusion == SUMMING:
            weight = math.exp(found.log - top) / total
            mean = m0 / total, m1 / total, m2 / total
        else:
            mean = found.g0, found.g1, found.g2
        share, moved = weight * found.share, by_moving[k]
        for i in range(3):
            moved[i, 0] = moved[i, 1] = by_value[k, i] = by_input[k, i] = 0.0
        pairs = near[: found.within]
        add_inliers(w, target, factor, weight * found.scale, mean, pairs, weights, moved)
        if outlier[KIND] == CORRUPTED and found.outlier_scale > 0.0:
            scale, rest = weight * found.outlier_scale, weight * (1.0 - found.share)
            add_outliers_fixed(w, sums, target, precision, scale, mean)
            add_outliers_moving(target, outliers, precision, rest, mean, moved)
        rotate_back(moved, setting)
        if factors.shape[0] > 0:
            centred = (
                share * (found.i0 - mean[0]),
                share * (found.i1 - mean[1]),
                share * (found.i2 - mean[2]),
            )
            write_measured(factor, share, centred, by_value[k], by_input[k])
    for i in range(fixed.shape[1]):
        at = (i // LANES) * BLOCK + i % LANES + CROSS * LANES
        for row in range(6):
            by_fixed[i, row // 2, row % 2] = w[at + row * LANES]


@entry
def cross_batch(batch, thetas, begin, work, by_fixed, by_moving, by_value, by_input):
    """Derivatives of the gradients of some problems, from ``begin`` on, in all that is measured.

    In the fixed and moving means (C, targets, 3, 2), in the measurements' values (C, targets, 3)
    and, through their predictions only, in their inputs (C, targets, 3); the targets of a problem's
    pairs one pair after the other.
    """
    for c in range(by_fixed.shape[0]):
        b, fixed_done, moving_done = begin + c, 0, 0
        for number in range(batch.first[b], batch.first[b + 1]):
            pair = pair_at(batch, number)
            chart = motion_chart(batch, number, thetas[b])
            setting = setting_of(pair, (chart.x, chart.y, chart.phi))
            n, k = pair.fixed.shape[1], pair.moving.shape[1]
            own_fixed = by_fixed[c, fixed_done : fixed_done + n]
            own_moving = by_moving[c, moving_done : moving_done + k]
            own_value = by_value[c, moving_done : moving_done + k]
            own_input = by_input[c, moving_done : moving_done + k]
            cross_pair(
                pair, setting, batch.fusion, work, own_fixed, own_moving, own_value, own_input
            )
            interval = batch.intervals[number]
            for i in range(n):
                scale_rows(own_fixed[i, :, 0], chart, interval)
                scale_rows(own_fixed[i, :, 1], chart, interval)
            for j in range(k):
                scale_rows(own_moving[j, :, 0], chart, interval)
                scale_rows(own_moving[j, :, 1], chart, interval)
                scale_rows(own_value[j], chart, interval)
                scale_rows(own_input[j], chart, interval)
            fixed_done += n
            moving_done += k
