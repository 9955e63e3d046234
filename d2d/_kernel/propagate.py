"""Derivatives of the gradient in every measured coordinate, for the propagation of errors.

Every cost has the gradient ``f_theta = -sum_ki gamma_ki L_theta,ki`` with responsibilities gamma
that sum to one over a target's components (likelihood) or over all pairs (summing), and with the
mean gradient g over the same pairs::

    f_theta,z = -sum_ki gamma_ki (L_theta,z + (L_theta - g) L_z')

The cost's own pass leaves g and the factors that turn weights into responsibilities; a second pass
over the pairs adds up f_theta,z.
"""

import math

import numpy as np

from d2d._kernel import layout, rows
from d2d._kernel.compile import compiled, entry, inlined, vectorised
from d2d._kernel.cost import align_tops, evaluate_block, motion_chart, pair_at, setting_of, total
from d2d._kernel.densities import half_square, measurement_at, precision_of
from d2d._kernel.elementary import exp
from d2d._kernel.jets import fuse_summing, gradient_through_chart
from d2d._kernel.layout import WEIGHT, X, Y
from d2d._kernel.neighbours import difference
from d2d._kernel.pairs import component_at, repeat
from d2d._kernel.rows import LANES, lane_count

ROWS = 6 * LANES  # of one component's cross derivatives, lane by lane


@vectorised
def cross_terms(gamma, centred, u, precision, v):
    """gamma (B [e_x, e_y, v] + u c')', row by row: what a pair adds to -f_theta,z of its mean.

    With u = B d, the gradient c of the pair's logarithm less the mean one, and v = E p - C_phi u.
    """
    bxx, bxy, byy = precision
    c0, c1, c2 = centred
    ux, uy = u
    return (
        gamma * (bxx + c0 * ux),
        gamma * (bxy + c0 * uy),
        gamma * (bxy + c1 * ux),
        gamma * (byy + c1 * uy),
        gamma * (bxx * v[0] + bxy * v[1] + c2 * ux),
        gamma * (bxy * v[0] + byy * v[1] + c2 * uy),
    )


@vectorised
def inlier_terms(w, step, setting):
    """The terms of one pair of each target, see `pairs.add_step`; adds them to the targets' own."""
    for k in range(lane_count(w)):
        component = component_at(step, k, setting)
        dx, dy, sxx, sxy, syy, square, determinant = difference(w, k, component)
        x, y, inverse = w[rows.MX + k], w[rows.MY + k], 1.0 / determinant
        bxx, bxy, byy = syy * inverse, -sxy * inverse, sxx * inverse
        ux, uy = bxx * dx + bxy * dy, bxy * dx + byy * dy
        gamma = w[rows.SCALE + k] * step[WEIGHT * LANES + k] * math.sqrt(inverse)
        gamma *= exp(min(w[rows.OFFSET + k] - 0.5 * square * inverse, layout.MAX_EXPONENT))
        # C_phi = [[a, h], [h, -a]]
        a, h = -2.0 * w[rows.CXY + k], w[rows.CXX + k] - w[rows.CYY + k]
        bent_x, bent_y = a * ux + h * uy, h * ux - a * uy
        turn = ux * (0.5 * bent_x + y) + uy * (0.5 * bent_y - x)
        turn -= 0.5 * (a * (bxx - byy) + 2.0 * h * bxy)
        centred = (
            w[rows.FACTOR + rows.G0 + k] - ux - w[rows.MEAN + k],
            w[rows.FACTOR + rows.G1 + k] - uy - w[rows.MEAN + LANES + k],
            w[rows.FACTOR + rows.G2 + k] + turn - w[rows.MEAN + 2 * LANES + k],
        )
        terms = cross_terms(gamma, centred, (ux, uy), (bxx, bxy, byy), (-y - bent_x, x - bent_y))
        for row in range(6):
            w[rows.TERMS + row * LANES + k] = terms[row]
            w[rows.MOVED + row * LANES + k] += terms[row]
        w[rows.MOVED + 4 * LANES + k] += gamma * uy  # d_phi = E p depends on the target's position
        w[rows.MOVED + 5 * LANES + k] -= gamma * ux
        w[rows.GAMMA + k] += gamma
        for row in range(3):
            w[rows.CENTRED + row * LANES + k] += gamma * centred[row]


@compiled
def add_inliers(w, fixed, setting, lists, cross):
    """Add the pairs of a block's neighbours, which the first pass has left at its ``lists``."""
    dense = lists[rows.LENGTH] == rows.DENSE
    step = lists[rows.PLACE : rows.PLACE + 6 * LANES]  # which are not there if dense
    for n in range(fixed.shape[1] if dense else int(lists[rows.LENGTH])):
        at = rows.PLACE + n * rows.STEP
        if dense:
            repeat(step, fixed, n)
            inlier_terms(w, step, setting)
        else:
            inlier_terms(w, lists[at : at + rows.STEP], setting)
        for k in range(LANES):
            i = n if dense else int(lists[at + rows.INDEX * LANES + k])
            for row in range(6 if i >= 0 else 0):
                cross[i * ROWS + row * LANES + k] -= w[rows.TERMS + row * LANES + k]


@vectorised
def move_outliers(w):
    """Add what the pairs of the corrupted Gaussian mean for their targets.

    It follows from their derivatives in the motion: those in the position are the same.
    """
    at = rows.OUTLIER
    for k in range(lane_count(w)):
        x, y = w[rows.MX + k], w[rows.MY + k]
        s = w[rows.OUTLIER_SCALE + k] / w[rows.OUTLIER_TO_SHARE + k]
        m0, m1, m2 = w[rows.MEAN + k], w[rows.MEAN + LANES + k], w[rows.MEAN + 2 * LANES + k]
        g0, g1 = w[at + rows.G0 + k], w[at + rows.G1 + k]
        a00, a01, a11 = w[at + rows.A00 + k], w[at + rows.A01 + k], w[at + rows.A11 + k]
        w[rows.MOVED + k] += s * (m0 * g0 - a00)
        w[rows.MOVED + LANES + k] += s * (m0 * g1 - a01)
        w[rows.MOVED + 2 * LANES + k] += s * (m1 * g0 - a01)
        w[rows.MOVED + 3 * LANES + k] += s * (m1 * g1 - a11)
        w[rows.MOVED + 4 * LANES + k] += s * (m2 * g0 + y * a00 - x * a01 - g1)
        w[rows.MOVED + 5 * LANES + k] += s * (m2 * g1 + y * a01 - x * a11 + g0)


@vectorised
def add_corrupted(w, fixed, setting, outlier, cross):
    """Add the pairs of all targets and components in the corrupted Gaussian."""
    lanes = lane_count(w)
    bxx, bxy, byy = precision = precision_of(outlier)
    for i in range(fixed.shape[1]):
        own = cross[i * ROWS : (i + 1) * ROWS]
        mean, weight = (fixed[X, i] - setting.x, fixed[Y, i] - setting.y), fixed[WEIGHT, i]
        for k in range(lanes):
            dx, dy, half = half_square(w, k, mean, precision)
            gamma = w[rows.OUTLIER_SCALE + k] * weight
            gamma *= exp(min(w[rows.OUTLIER_OFFSET + k] - half, layout.MAX_EXPONENT))
            ux, uy = bxx * dx + bxy * dy, bxy * dx + byy * dy
            x, y = w[rows.MX + k], w[rows.MY + k]
            centred = (
                -ux - w[rows.MEAN + k],
                -uy - w[rows.MEAN + LANES + k],
                y * ux - x * uy - w[rows.MEAN + 2 * LANES + k],
            )
            terms = cross_terms(gamma, centred, (ux, uy), precision, (-y, x))
            for row in range(6):
                own[row * LANES + k] -= terms[row]


@inlined
def prepare_targets(w, outlier, fusion, measured, top):
    """Set the scales and mean gradients of a block's targets, and all their sums to zero.

    ``top`` is the logarithm of the density that all targets share in the sum.
    """
    for k in range(LANES):
        scale = w[rows.COUNTS + k]
        if fusion == layout.SUMMING:
            scale *= math.exp(w[rows.INLIER + k] - top)
        share = w[rows.SHARE + k] if outlier[layout.KIND] != layout.NO_OUTLIER else 1.0
        w[rows.SCALE + k] = scale * share * w[rows.TO_SHARE + k]
        w[rows.OUTLIER_SCALE + k] = scale * (1.0 - share) * w[rows.OUTLIER_TO_SHARE + k]
        if fusion != layout.SUMMING:
            for row in range(3):
                w[rows.MEAN + row * LANES + k] = w[rows.INLIER + rows.G0 + row * LANES + k]
        if not measured:
            for row in range(3):
                w[rows.FACTOR + rows.G0 + row * LANES + k] = 0.0
        w[rows.GAMMA + k] = 0.0
        for row in range(3):
            w[rows.CENTRED + row * LANES + k] = 0.0
        for row in range(6):
            w[rows.MOVED + row * LANES + k] = 0.0


@compiled
def measurement_slopes(factor, chart):
    """Slopes of a measurement's log density and gradient by its two errors.

    By the measured value, and by the input through the prediction alone.
    """
    xi = chart.x, chart.y, chart.phi
    (h0, h1, h2), (s0, s1, s2), residual, slope, variance = measurement_at(factor, xi)
    e = residual / variance
    along = 2.0 * factor[layout.INPUT_VARIANCE] * slope * e / variance
    v0, v1, v2 = h0 / variance + along * s0, h1 / variance + along * s1, h2 / variance + along * s2
    i0, i1, i2 = e * s0 - slope * v0, e * s1 - slope * v1, e * s2 - slope * v2
    by_value = gradient_through_chart(v0, v1, v2, chart)
    by_input = gradient_through_chart(i0, i1, i2, chart)
    return -e, by_value, slope * e, by_input


@inlined
def cross_pair(pair, setting, fusion, memory, cross, own):
    """Cross derivatives of one pair of sets, of the gradient in the motion.

    With the sum, all targets share one density and one mean gradient, which a first round finds.
    """
    by_fixed, by_moving, by_value, by_input, shares = own
    w, lists = memory.scratch, memory.lists[0]
    fixed, moving, order = pair.fixed, pair.moving, pair.order
    factors, outlier = pair.factors, pair.outlier
    measured, top = factors.shape[0] > 0, 0.0
    corrupted = outlier[layout.KIND] == layout.CORRUPTED  # one that depends on the components
    cross = cross[: fixed.shape[1] * ROWS]
    cross[:] = 0.0
    for k in range(10 * LANES):
        w[rows.TOTAL + k] = 0.0
    for k in range(LANES):
        w[rows.TOP + k] = -np.inf
    blocks = (moving.shape[1] + LANES - 1) // LANES
    rounds = 2 if fusion == layout.SUMMING else 1
    for visit in range(rounds * blocks):
        first = visit % blocks * LANES
        lists[rows.LENGTH] = rows.NOT_FOUND
        if memory.stop[0] != 0.0:
            return
        evaluate_block(memory, pair, setting, first, 0.0, lists)
        if visit < (rounds - 1) * blocks:
            fuse_summing(w)
            if visit == blocks - 1:
                top, sums = align_tops(w), total(w, 0)
                top += math.log(sums)
                for row in range(3):
                    mean = total(w, rows.G0 + row * LANES) / sums
                    for k in range(LANES):
                        w[rows.MEAN + row * LANES + k] = mean
            continue
        prepare_targets(w, outlier, fusion, measured, top)
        add_inliers(w, fixed, setting, lists, cross)
        if corrupted:
            move_outliers(w)
            add_corrupted(w, fixed, setting, outlier, cross)
        for k in range(min(LANES, moving.shape[1] - first)):
            j = order[first + k]
            shares[j] = w[rows.SHARE + k] if outlier[layout.KIND] != layout.NO_OUTLIER else 1.0
            for i in range(3):
                x, y = w[rows.MOVED + 2 * i * LANES + k], w[rows.MOVED + (2 * i + 1) * LANES + k]
                # from the rotated mean to the mean itself
                by_moving[j, i, 0] = setting.cosine * x + setting.sine * y
                by_moving[j, i, 1] = setting.cosine * y - setting.sine * x
                by_value[j, i] = by_input[j, i] = 0.0
            if measured:
                in_value, by_v, in_input, by_i = measurement_slopes(factors[j], setting.chart)
                for i in range(3):
                    centred = w[rows.CENTRED + i * LANES + k]
                    by_value[j, i] = -w[rows.GAMMA + k] * by_v[i] - centred * in_value
                    by_input[j, i] = -w[rows.GAMMA + k] * by_i[i] - centred * in_input
    for i in range(fixed.shape[1]):
        for row in range(6):
            added = 0.0
            for k in range(LANES):
                added += cross[i * ROWS + row * LANES + k]
            by_fixed[i, row // 2, row % 2] = added


@compiled
def scale_rows(by_motion, chart, interval):
    """Turn derivatives of the gradient in a motion into those of the gradient in its velocity."""
    g0, g1, g2 = gradient_through_chart(by_motion[0], by_motion[1], by_motion[2], chart)
    by_motion[0], by_motion[1], by_motion[2] = interval * g0, interval * g1, interval * g2


@entry
def cross_batch(batch, thetas, begin, memory, cross, derivatives):
    """Derivatives of the gradients of some problems, from ``begin`` on, in all that is measured.

    In the fixed and moving means (C, targets, 3, 2), in the measurements' values (C, targets, 3)
    and, through their predictions only, in their inputs (C, targets, 3); the targets of a problem's
    pairs one pair after the other.  Then the share (C, targets) of the inliers in each density.
    ``cross`` is memory, ROWS for each target of a fixed set.
    """
    by_fixed, by_moving, by_value, by_input, shares = derivatives
    for c in range(by_fixed.shape[0]):
        b, fixed_done, moving_done = begin + c, 0, 0
        for number in range(batch.first[b], batch.first[b + 1]):
            pair = pair_at(batch, number, 1.0)
            chart = motion_chart(batch, number, thetas[b])
            setting = setting_of(pair, (chart.x, chart.y, chart.phi), layout.GATE)
            n, m = pair.fixed.shape[1], pair.moving.shape[1]
            own_fixed = by_fixed[c, fixed_done : fixed_done + n]
            own_moving = by_moving[c, moving_done : moving_done + m]
            own_value = by_value[c, moving_done : moving_done + m]
            own_input = by_input[c, moving_done : moving_done + m]
            share = shares[c, moving_done : moving_done + m]
            own = own_fixed, own_moving, own_value, own_input, share
            cross_pair(pair, setting, batch.fusion, memory, cross, own)
            interval = batch.intervals[number]
            for i in range(n):
                scale_rows(own_fixed[i, :, 0], chart, interval)
                scale_rows(own_fixed[i, :, 1], chart, interval)
            for j in range(m):
                scale_rows(own_moving[j, :, 0], chart, interval)
                scale_rows(own_moving[j, :, 1], chart, interval)
                scale_rows(own_value[j], chart, interval)
                scale_rows(own_input[j], chart, interval)
            fixed_done += n
            moving_done += m
